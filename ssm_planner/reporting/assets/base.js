// Functions that all scripts of the pages use: elements, formatted numbers, colours and the embedded data.
"use strict";
const SSM = {};

// Create an element. An attribute whose name begins with "on" is an event listener.
const element = (name, attributes = {}, ...children) => {
  const node = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (key.startsWith("on")) node.addEventListener(key.slice(2), value);
    else if (value === true) node.setAttribute(key, "");
    else if (value !== false && value != null) node.setAttribute(key, value);
  }
  node.append(...children.filter((child) => child != null));
  return node;
};

// Create a vertical line in a track. `at` moves it to a fraction of the width, without a new layout of the page.
SSM.cursor = () => {
  const node = element("span", { class: "cursor" });
  return { node, at: (share) => { node.style.transform = `translateX(${100 * share}%)`; } };
};

// Create a bar for an interval of time in a track that lasts from `first` to `last`, s.
SSM.bar = (kind, text, { start, end }, first, last) => {
  const node = element("span", { class: kind, title: `${text}: ${start.toFixed(3)}–${end.toFixed(3)} s` });
  node.style.left = `${(100 * (start - first)) / (last - first)}%`;
  node.style.width = `${(100 * (end - start)) / (last - first)}%`;
  return node;
};

// Let the browser save a file with this content.
SSM.download = (name, content, type) => {
  const href = URL.createObjectURL(new Blob([content], { type }));
  element("a", { href, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(href), 1000);
};

// Set the text of a node if it differs from the present one.
SSM.setText = (node, text) => { if (node.shownText !== text) node.textContent = node.shownText = text; };

const byId = (name) => document.getElementById(name);

SSM.data = () => JSON.parse(byId("data").textContent);

// Decode base64 text that contains little-endian doubles, the byte order of all machines that run browsers.
SSM.decodeDoubles = (text) => {
  if (Uint8Array.fromBase64) return new Float64Array(Uint8Array.fromBase64(text).buffer);
  return new Float64Array(Uint8Array.from(atob(text), (character) => character.charCodeAt(0)).buffer);
};

// Return an object with all channels (sampled quantities). A channel is decoded at its first use.
SSM.channels = (encoded) => {
  const channels = {};
  for (const [name, text] of Object.entries(encoded)) {
    Object.defineProperty(channels, name, { enumerable: true, configurable: true, get: () => {
      Object.defineProperty(channels, name, { value: SSM.decodeDoubles(text), enumerable: true });
      return channels[name];
    } });
  }
  return channels;
};

// Return the four joint positions (rad and m) at an instant.
SSM.joints = (channels, index) => [0, 1, 2, 3].map((i) => channels[`q${i}`][index]);
// Return the positions of the tip at all instants, m.
SSM.tipPath = (channels) => Array.from(channels.t, (_, i) => SSM.vector([0, 1, 2].map((k) => channels[`tip${k}`][i])));

// Format a number with a fixed number of decimals and a typographic minus sign.
const fixed = (value, digits) => {
  const text = value.toFixed(digits);
  return Number(text) === 0 ? text.replace("-", "") : text.replace("-", "−");
};

// Format a number with at most this number of significant digits.
const rounded = (value, digits) => String(Number(value.toPrecision(digits))).replace("-", "−");

// Dash patterns of joints 1 to 4 and of a fifth curve.
SSM.dashes = [[], [9, 5], [10, 4, 2, 4], [2, 4], [12, 3, 2, 3, 2, 3]];

SSM.prefersReducedMotion = matchMedia("(prefers-reduced-motion: reduce)").matches;

// Colours in dark mode by colour in light mode. They are light enough for a dark background, and as distinct.
SSM.darkModeColours = { "#0072B2": "#56B4E9", "#D55E00": "#FF9A4D", "#009E73": "#35D0A2", "#000000": "#E8EBEE", "#A0457E": "#E08CC4",
  "#8c2d1a": "#ff9d85", "#a8482c": "#ffb08f", "#1c5f92": "#8cc8f5" };
SSM.darkMode = matchMedia("(prefers-color-scheme: dark)");
SSM.isPrinting = false;
SSM.isDark = () => SSM.darkMode.matches && !SSM.isPrinting;
// Return a colour for a style sheet, and for a canvas.
SSM.cssColour = (colour) => (SSM.darkModeColours[colour] ? `light-dark(${colour}, ${SSM.darkModeColours[colour]})` : colour);
SSM.canvasColour = (colour) => (SSM.isDark() && SSM.darkModeColours[colour]) || colour;
const themeColour = (name) => SSM.themes[SSM.isDark() ? 1 : 0][name];
SSM.themes = [
  { text: "#333b45", grid: "#e3e7ec", tick: "#c3cad3", limit: "#5b6470", stripe: "#eef1f5", paper: "#ffffff", regions: ["#e7ebf0", "#c9d8e6"], scene: 0xf7f8fa },
  { text: "#c6ced7", grid: "#2b333d", tick: "#47525e", limit: "#9aa5b1", stripe: "#1e252d", paper: "#14191f", regions: ["#222a33", "#2c4255"], scene: 0x46515d },
];

// Call a function when everything on a canvas must be drawn again: for another colour scheme, and before and after printing.
SSM.onRedraw = (redraw) => {
  SSM.darkMode.addEventListener("change", redraw);
  for (const [name, printing] of [["beforeprint", true], ["afterprint", false]]) {
    addEventListener(name, () => { SSM.isPrinting = printing; redraw(); });
  }
};

SSM.textMeasure = document.createElement("canvas").getContext("2d");
SSM.textMeasure.font = "11px system-ui, sans-serif";
// Return the first text that is narrower than a width in pixels.
SSM.firstFit = (texts, width, context = SSM.textMeasure) => texts.find((text) => context.measureText(text).width + 1 < width) ?? "";
// Return the longest form of a phase's name that fits: whole, without its group, or its number alone.
SSM.fitPhaseName = (name, width) => {
  const shortName = name.split(", ").pop();
  return SSM.firstFit([name, shortName, shortName.match(/\d+$/)?.[0] ?? ""], width);
};

// Create a short line with a colour and a dash pattern for a legend.
SSM.swatch = (colour, dash, width = 2.5) => {
  const holder = element("span");
  holder.innerHTML = `<svg width=28 height=8 aria-hidden=true><line x2=28 y1=4 y2=4 stroke-width=${width} stroke-dasharray="${dash.join(" ")}" /></svg>`;
  const svg = holder.firstChild;
  svg.firstChild.style.stroke = SSM.cssColour(colour);
  return svg;
};

// Return the smallest and the largest of the values that are not null.
SSM.extremes = (values) => {
  let [low, high] = [Infinity, -Infinity];
  for (const value of values) {
    if (value === null) continue;
    if (value < low) low = value;
    if (value > high) high = value;
  }
  return [low, high];
};
