// What the page's scripts share: elements, numbers, the embedded data.
"use strict";
const SSM = {};

SSM.element = (name, attributes = {}, ...children) => {
  const node = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (key.startsWith("on")) node.addEventListener(key.slice(2), value);
    else if (value === true) node.setAttribute(key, "");
    else if (value !== false && value !== null && value !== undefined) node.setAttribute(key, value);
  }
  node.append(...children.filter((child) => child !== null && child !== undefined));
  return node;
};

SSM.data = () => JSON.parse(document.getElementById("data").textContent);

// base64 of little-endian doubles, which is how every machine with a browser holds them
SSM.decode = (text) => new Float64Array(Uint8Array.from(atob(text), (character) => character.charCodeAt(0)).buffer);

SSM.channels = (encoded) => Object.fromEntries(Object.entries(encoded).map(([name, text]) => [name, SSM.decode(text)]));

SSM.fixed = (value, digits) => {
  const text = value.toFixed(digits);
  return Number(text) === 0 ? text.replace("-", "") : text.replace("-", "−");
};

SSM.dashes = [[], [9, 5], [10, 4, 2, 4], [2, 4], [12, 3, 2, 3, 2, 3]];

SSM.calm = window.matchMedia("(prefers-reduced-motion: reduce)").matches;

// a short line in a colour and dash, as a key beside text
SSM.swatch = (colour, dash, width = 2.5) => {
  const space = "http://www.w3.org/2000/svg";
  const svg = document.createElementNS(space, "svg");
  const line = document.createElementNS(space, "line");
  for (const [key, value] of [["width", 28], ["height", 8], ["aria-hidden", "true"]]) svg.setAttribute(key, value);
  for (const [key, value] of [["x1", 0], ["x2", 28], ["y1", 4], ["y2", 4], ["stroke", colour], ["stroke-width", width]]) {
    line.setAttribute(key, value);
  }
  line.setAttribute("stroke-dasharray", dash.join(" "));
  svg.append(line);
  return svg;
};
