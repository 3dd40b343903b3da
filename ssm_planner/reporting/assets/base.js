// What the page's scripts share: elements, numbers, the embedded data.
"use strict";
const SSM = {};

const element = (name, attributes = {}, ...children) => {
  const node = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (key.startsWith("on")) node.addEventListener(key.slice(2), value);
    else if (value === true) node.setAttribute(key, "");
    else if (value !== false && value !== null && value !== undefined) node.setAttribute(key, value);
  }
  node.append(...children.filter((child) => child !== null && child !== undefined));
  return node;
};

// a line across its frame at a share of the width; moved without a new layout
SSM.cursor = () => {
  const node = element("span", { class: "cursor" });
  return { node, at: (share) => { node.style.transform = `translateX(${100 * share}%)`; } };
};

// saves a file with this content
SSM.download = (name, content, type) => {
  const href = URL.createObjectURL(new Blob([content], { type }));
  element("a", { href, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(href), 1000);
};

// text of a node, written where it changed
SSM.say = (node, text) => { if (node.said !== text) node.textContent = node.said = text; };

const byId = (name) => document.getElementById(name);

SSM.data = () => JSON.parse(byId("data").textContent);

// base64 of little-endian doubles, which is how every machine with a browser holds them
SSM.decode = (text) => {
  if (Uint8Array.fromBase64) return new Float64Array(Uint8Array.fromBase64(text).buffer);
  const characters = atob(text);
  const bytes = new Uint8Array(characters.length);
  for (let i = 0; i < bytes.length; i++) bytes[i] = characters.charCodeAt(i);
  return new Float64Array(bytes.buffer);
};

// each decoded when it is first asked for
SSM.channels = (encoded) => {
  const channels = {};
  for (const [name, text] of Object.entries(encoded)) {
    Object.defineProperty(channels, name, { enumerable: true, configurable: true, get: () => {
      Object.defineProperty(channels, name, { value: SSM.decode(text), enumerable: true });
      return channels[name];
    } });
  }
  return channels;
};

SSM.joints = (channels, index) => [0, 1, 2, 3].map((i) => channels[`q${i}`][index]);
// places of the tip
SSM.trace = (channels) => Array.from(channels.t, (_, i) => SSM.vector([0, 1, 2].map((k) => channels[`tip${k}`][i])));

const fixed = (value, digits) => {
  const text = value.toFixed(digits);
  return Number(text) === 0 ? text.replace("-", "") : text.replace("-", "−");
};

const rounded = (value, digits) => String(Number(value.toPrecision(digits))).replace("-", "−");

SSM.dashes = [[], [9, 5], [10, 4, 2, 4], [2, 4], [12, 3, 2, 3, 2, 3]];

SSM.calm = matchMedia("(prefers-reduced-motion: reduce)").matches;

// in dark mode: as far apart, and light enough on dark
SSM.night = { "#0072B2": "#56B4E9", "#D55E00": "#FF9A4D", "#009E73": "#35D0A2", "#000000": "#E8EBEE", "#A0457E": "#E08CC4",
  "#8c2d1a": "#ff9d85", "#a8482c": "#ffb08f", "#1c5f92": "#8cc8f5" };
SSM.scheme = matchMedia("(prefers-color-scheme: dark)");
SSM.printing = false;
SSM.dark = () => SSM.scheme.matches && !SSM.printing;
// for a style, and for a canvas
SSM.paint = (colour) => (SSM.night[colour] ? `light-dark(${colour}, ${SSM.night[colour]})` : colour);
SSM.tone = (colour) => (SSM.dark() && SSM.night[colour]) || colour;
const ink = (name) => SSM.inks[SSM.dark() ? 1 : 0][name];
SSM.inks = [
  { text: "#333b45", grid: "#e3e7ec", tick: "#c3cad3", limit: "#5b6470", stripe: "#eef1f5", paper: "#ffffff", regions: ["#e7ebf0", "#c9d8e6"], scene: 0xf7f8fa },
  { text: "#c6ced7", grid: "#2b333d", tick: "#47525e", limit: "#9aa5b1", stripe: "#1e252d", paper: "#14191f", regions: ["#222a33", "#2c4255"], scene: 0x46515d },
];

// once for everything drawn on a canvas: another colour scheme, and paper
SSM.whenRedrawn = (redraw) => {
  SSM.scheme.addEventListener("change", redraw);
  for (const [name, printing] of [["beforeprint", true], ["afterprint", false]]) {
    addEventListener(name, () => { SSM.printing = printing; redraw(); });
  }
};

// the longest of a phase's names that fits a width: whole, without its group, its number alone
SSM.pen = document.createElement("canvas").getContext("2d");
SSM.pen.font = "11px system-ui, sans-serif";
SSM.fitting = (name, width) => {
  const own = name.split(", ").pop();
  return [name, own, own.match(/\d+$/)?.[0] ?? ""].find((text) => SSM.pen.measureText(text).width + 1 < width) ?? "";
};

// a short line in a colour and dash, as a key beside text
SSM.swatch = (colour, dash, width = 2.5) => {
  const holder = element("span");
  holder.innerHTML = `<svg width=28 height=8 aria-hidden=true><line x2=28 y1=4 y2=4 stroke-width=${width} stroke-dasharray="${dash.join(" ")}" /></svg>`;
  const svg = holder.firstChild;
  svg.firstChild.style.stroke = SSM.paint(colour);
  return svg;
};

// the least and the largest of values, without those that are null
SSM.extremes = (values) => {
  let [low, high] = [Infinity, -Infinity];
  for (const value of values) {
    if (value === null) continue;
    if (value < low) low = value;
    if (value > high) high = value;
  }
  return [low, high];
};
