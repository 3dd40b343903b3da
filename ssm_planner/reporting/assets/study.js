// Draw the page of a study: Pareto front, map of rejected candidates, and parallel coordinates with brushes, on plain canvases.
// A brush is a range on an axis of the parallel coordinates. Candidates outside of a brush appear faint.
"use strict";
const data = SSM.data();
const COLOURS = ["#0072B2", "#D55E00", "#009E73", "#A0457E", "#000000"];
const translucentGrey = (opacity) => { // a translucent grey, which becomes darker where marks overlap
  const [r, g, b] = SSM.isDark() ? [170, 182, 194] : [90, 100, 112];
  return `rgba(${r}, ${g}, ${b}, ${opacity})`;
};
const column = (name) => data.columns[data.names.indexOf(name)];
const brushes = new Map();
const isSelected = (i) => [...brushes].every(([name, [low, high]]) => column(name).at[i] >= low && column(name).at[i] <= high);

// Prepare a canvas with the resolution of the screen. draw(context, width, height) is called at the start and after every change of its size.
const makeCanvas = (id, draw) => {
  const canvas = byId(id);
  const paint = () => {
    const scale = devicePixelRatio, width = canvas.clientWidth, height = canvas.clientHeight;
    canvas.width = width * scale;
    canvas.height = height * scale;
    const context = canvas.getContext("2d");
    context.scale(scale, scale);
    context.clearRect(0, 0, width, height);
    context.font = "12px system-ui, sans-serif";
    draw(context, width, height);
  };
  new ResizeObserver(paint).observe(canvas);
  SSM.onRedraw(paint);
  return { canvas, paint };
};

const paddedRange = (values) => {
  const [low, high] = SSM.extremes(values);
  return low < high ? [low, high] : [low - 1, high + 1];
};
const ticks = ([low, high]) => {
  const raw = (high - low) / 5, power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((each) => each * power).find((each) => each >= raw);
  const found = [];
  for (let at = Math.ceil(low / step) * step; at <= high + step * 1e-9; at += step) found.push(at);
  return found.map((at) => [at, rounded(at, 6)]);
};
const label = (of, value, digits = 5) => (of.labels ? of.labels[value] : rounded(value, digits));
// Return the longest form of a title that fits: whole, without the path before its last word, or truncated.
const shortened = (context, title, width) => {
  const lastWord = title.replace(/^\S*\./, "");
  const cut = Array.from({ length: lastWord.length }, (_, n) => `${lastWord.slice(0, lastWord.length - n)}…`);
  return SSM.firstFit([title, lastWord, ...cut], width, context);
};

// Draw the axes of a plot, and return functions that convert values to pixels.
const EDGE = { left: 64, right: 14, top: 12, bottom: 44 };
const axes = (context, width, height, across, up) => {
  const [x, y] = [paddedRange(across.at), paddedRange(up.at)].map(([low, high]) => [low - (high - low) * 0.03, high + (high - low) * 0.03]);
  const px = (value) => EDGE.left + ((value - x[0]) / (x[1] - x[0])) * (width - EDGE.left - EDGE.right);
  const py = (value) => height - EDGE.bottom - ((value - y[0]) / (y[1] - y[0])) * (height - EDGE.top - EDGE.bottom);
  context.strokeStyle = themeColour("tick");
  context.fillStyle = themeColour("text");
  context.strokeRect(EDGE.left, EDGE.top, width - EDGE.left - EDGE.right, height - EDGE.top - EDGE.bottom);
  context.textAlign = "center";
  const marks = (of, range) => (of.labels ? of.labels.map((text, i) => [i, text.slice(0, 14)]) : ticks(range));
  for (const [at, text] of marks(across, x).slice(0, 12)) context.fillText(text, px(at), height - EDGE.bottom + 16);
  context.fillText(across.title, (EDGE.left + width - EDGE.right) / 2, height - 8);
  context.textAlign = "right";
  for (const [at, text] of marks(up, y).slice(0, 20)) context.fillText(text, EDGE.left - 6, py(at) + 4);
  context.save();
  context.translate(13, (EDGE.top + height - EDGE.bottom) / 2);
  context.rotate(-Math.PI / 2);
  context.textAlign = "center";
  context.fillText(up.title, 0, 0);
  context.restore();
  return [px, py];
};
// Circle, square, triangle and diamond as SVG paths with a radius of about 1.
const SHAPES = ["M-1 0A1 1 0 0 0 1 0A1 1 0 0 0-1 0Z", "M-1-1H1V1H-1Z", "M0-1.2L1.1 1H-1.1Z", "M0-1.3L1.3 0L0 1.3L-1.3 0Z"].map((path) => new Path2D(path));
const point = (context, shape, x, y, radius, colour) => {
  context.save();
  context.translate(x, y);
  context.scale(radius, radius);
  context.fillStyle = colour;
  context.fill(SHAPES[shape % SHAPES.length]);
  context.restore();
};
const fill = (id, names, chosen, then) => {
  const select = byId(id);
  for (const name of names) select.add(new Option(column(name).title, name, false, name === chosen));
  select.addEventListener("change", then);
  return select;
};

const done = data.names.length ? data.state.flatMap((state, i) => (state === "done" ? [i] : [])) : [];
const onFront = new Set(data.front);
let nearest = null, isKept = false;
const numeric = data.names.filter((name) => !column(name).labels);
const across = fill("across", numeric, data.objectives[0], () => front.paint());
const up = fill("up", numeric, data.objectives[1] ?? data.choices.find((name) => numeric.includes(name)), () => front.paint());
const front = makeCanvas("front", (context, width, height) => {
  const doneOnly = (of) => ({ ...of, at: done.map((i) => of.at[i]) });
  const [px, py] = axes(context, width, height, doneOnly(column(across.value)), doneOnly(column(up.value)));
  const place = (i) => [px(column(across.value).at[i]), py(column(up.value).at[i])];
  front.places = done.map((i) => [i, ...place(i)]);
  for (const [i, x, y] of front.places) if (!onFront.has(i)) point(context, 0, x, y, 2.6, translucentGrey(isSelected(i) ? 0.4 : 0.12));
  for (const [i, x, y] of front.places) if (onFront.has(i)) point(context, 3, x, y, 4, isSelected(i) ? SSM.canvasColour(COLOURS[0]) : translucentGrey(0.25));
  if (nearest !== null) {
    const [x, y] = place(nearest);
    context.beginPath();
    context.arc(x, y, 8, 0, 7);
    context.strokeStyle = themeColour("text");
    context.stroke();
  }
});
// Describe the candidate nearest to the pointer, and offer its motions, or the command that writes their pages.
const choose = ({ offsetX: x, offsetY: y }) => {
  let best = Infinity;
  for (const [i, px, py] of front.places) {
    const distance = (px - x) ** 2 + (py - y) ** 2;
    if (distance < best) [best, nearest] = [distance, i];
  }
  if (nearest === null) return;
  const parts = data.names.map((name) => [column(name), column(name).at[nearest]]).filter(([, value]) => value !== null);
  const number = data.number[nearest];
  const links = data.reports.filter((href) => href.startsWith(`candidate_${number}/`))
    .map((href) => element("a", { href, target: "_blank", rel: "noopener" }, `Play ${href.split("/")[1]}`));
  byId("motions").replaceChildren(...links);
  byId("command").hidden = links.length > 0;
  byId("number").textContent = number;
  byId("chosen").textContent =
    `Candidate ${number}: ` + parts.map(([of, value]) => `${of.title} ${label(of, value)}`).join("; ");
  front.paint();
};
front.canvas.addEventListener("pointermove", (event) => isKept || choose(event));
front.canvas.addEventListener("click", (event) => {
  isKept = true;
  choose(event);
  byId("motions").firstChild?.click();
});

const stages = [...new Set(data.stage)].sort((a, b) => (b === "done") - (a === "done"));
const mapAcross = fill("map-across", data.choices, data.choices[0], () => map.paint());
const mapUp = fill("map-up", data.choices, data.choices[1] ?? data.choices[0], () => map.paint());
const map = makeCanvas("map", (context, width, height) => {
  const [px, py] = axes(context, width, height, column(mapAcross.value), column(mapUp.value));
  data.stage.forEach((stage, i) => {
    const [x, y] = [px(column(mapAcross.value).at[i]), py(column(mapUp.value).at[i])];
    const k = stages.indexOf(stage);
    point(context, k, x, y, 3, SSM.canvasColour(COLOURS[k % COLOURS.length]));
  });
});
byId("map-legend").append(...stages.map((stage, k) => {
  const shape = element("span", { "aria-hidden": "true" }, "●■▲◆"[k % 4]);
  shape.style.color = SSM.cssColour(COLOURS[k % COLOURS.length]);
  return element("li", {}, shape, ` ${stage}`);
}));

const lanes = [...data.choices, ...data.figures];
const parallel = makeCanvas("parallel", (context, width, height) => {
  const top = 46, bottom = 26;
  const edge = width < 600 ? 24 : 60;
  const spacing = (width - 2 * edge) / Math.max(lanes.length - 1, 1);
  const digits = spacing < 60 ? 3 : 5;
  const at = (k) => edge + k * spacing;
  const ranges = lanes.map((name) => paddedRange(done.map((i) => column(name).at[i])));
  const y = (k, value) => height - bottom - ((value - ranges[k][0]) / (ranges[k][1] - ranges[k][0])) * (height - top - bottom);
  parallel.lane = (x) => Math.max(0, Math.min(lanes.length - 1, Math.round((x - edge) / spacing)));
  parallel.value = (k, py) => ranges[k][0] + ((height - bottom - py) / (height - top - bottom)) * (ranges[k][1] - ranges[k][0]);
  const draw = (i, colour) => {
    context.beginPath();
    lanes.forEach((name, k) => {
      const value = column(name).at[i];
      if (value !== null) context.lineTo(at(k), y(k, value));
    });
    context.strokeStyle = colour;
    context.stroke();
  };
  const shown = done.filter(isSelected), step = Math.ceil(shown.length / 4000);
  byId("kept").textContent = `${shown.length} of ${done.length} kept` + (step > 1 ? `, every ${step}th drawn.` : ".");
  shown.forEach((i, k) => { if (k % step === 0 && !onFront.has(i)) draw(i, translucentGrey(0.2)); });
  shown.forEach((i) => { if (onFront.has(i)) draw(i, SSM.canvasColour(COLOURS[0])); });
  context.fillStyle = themeColour("text");
  context.textAlign = "center";
  lanes.forEach((name, k) => {
    context.strokeStyle = themeColour("text");
    context.beginPath();
    context.moveTo(at(k), top);
    context.lineTo(at(k), height - bottom);
    context.stroke();
    const write = (text, y) => { // keep the text inside the picture
      const half = context.measureText(text).width / 2 + 2;
      context.fillText(text, Math.min(Math.max(at(k), half), width - half), y);
    };
    write(shortened(context, column(name).title, spacing + (k % (lanes.length - 1) ? spacing : edge) - 8), 12 + 14 * (k % 2));
    write(label(column(name), ranges[k][1], digits) ?? "", top - 5);
    write(label(column(name), ranges[k][0], digits) ?? "", height - 10);
    const brush = brushes.get(name);
    if (brush) {
      context.fillStyle = "rgba(0, 114, 178, 0.25)";
      context.fillRect(at(k) - 9, y(k, brush[1]), 18, y(k, brush[0]) - y(k, brush[1]));
      context.fillStyle = themeColour("text");
    }
  });
});
let drag = null;
parallel.canvas.addEventListener("pointerdown", (event) => {
  drag = { k: parallel.lane(event.offsetX), start: event.offsetY };
  parallel.canvas.setPointerCapture(event.pointerId);
});
parallel.canvas.addEventListener("pointermove", (event) => {
  if (drag === null || Math.abs(event.offsetY - drag.start) < 4) return;
  const ends = [drag.start, event.offsetY].map((y) => parallel.value(drag.k, y)).sort((a, b) => a - b);
  brushes.set(lanes[drag.k], ends);
  parallel.paint();
});
parallel.canvas.addEventListener("pointerup", (event) => {
  if (drag !== null && Math.abs(event.offsetY - drag.start) < 4) brushes.delete(lanes[drag.k]);
  drag = null;
  parallel.paint();
  front.paint();
});
