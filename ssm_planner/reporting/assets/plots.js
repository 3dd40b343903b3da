// Plots over time with limits, active stretches and phases; hovering moves the scrubber.
"use strict";
SSM.Plots = class {
  constructor(container, player, colours, phases) {
    Object.assign(this, { container, player, colours, phases, all: [], section: null });
    this.sizes = new ResizeObserver((entries) => entries.forEach(({ target }) => target.resize?.()));
    this.seen = new IntersectionObserver((entries) => entries.forEach(({ target, isIntersecting }) => {
      if (isIntersecting && target.build) target.build();
      if (!target.plot) return;
      target.plot.visible = isIntersecting;
      target.plot.mark(player.index);
    }), { rootMargin: "300px" });
    window.addEventListener("beforeprint", () => container.querySelectorAll("figure").forEach((figure) => figure.build?.()));
    player.listen((index) => this.all.forEach((plot) => plot.visible && plot.mark(index)));
  }

  // panel: see html_panel.py; lines(): [{label, colour, dash, values}]; drawn when it comes near the window
  add(panel, times, lines) {
    if (panel.section !== this.section) this.open(panel.section);
    const figure = SSM.element("figure", {}, SSM.element("div", { class: "plot" }));
    this.grid.append(figure);
    figure.build = () => {
      figure.build = null;
      this.#build(figure, panel, times, lines());
    };
    this.seen.observe(figure);
  }

  #build(figure, panel, times, lines) {
    const holder = figure.firstChild;
    holder.before(this.#caption(panel, lines));
    const range = this.#range(panel, lines);
    const options = {
      width: Math.max(200, holder.clientWidth),
      height: 190,
      padding: [14, 10, 0, 0],
      legend: { show: false },
      cursor: { y: false, points: { show: false }, drag: { x: true, y: false } },
      scales: { x: { time: false }, y: { range } },
      axes: [SSM.axis("", 34, "s"), SSM.axis("", 52)],
      series: [{}, ...lines.map(({ colour, dash, label }) => ({ stroke: colour, width: 1.8, dash, label, points: { show: false } }))],
      hooks: {
        drawClear: [(u) => SSM.shade(u, this.phases)],
        draw: [(u) => SSM.drawLimits(u, panel, this.colours)],
        setScale: [(u, key) => key === "x" && this.#zoom(u)],
      },
    };
    const rows = [times, ...lines.map(({ values }) => values)];
    const u = new uPlot(options, rows, holder);
    this.#attach(u, holder, figure);
  }

  open(section) {
    this.section = section;
    this.grid = SSM.element("div", { class: "grid" });
    this.container.append(SSM.element("h2", {}, section), this.grid);
  }

  // words at the end of a section, which is opened if it is not there yet
  note(section, words) {
    if (!words.length) return;
    if (section !== this.section) this.open(section);
    this.container.append(...words.map((text) => SSM.element("p", { class: "note" }, text)));
  }

  #attach(u, holder, figure) {
    const line = SSM.element("div", { class: "instant" });
    u.over.append(line);
    const plot = { u, visible: true, mark: (index) => {
      const x = u.valToPos(this.player.times[index], "x");
      line.style.transform = `translateX(${x}px)`;
      line.style.display = x < -1 || x > u.over.clientWidth + 1 ? "none" : "block";
    } };
    const follow = (event) => {
      if (event.buttons && event.pointerType === "mouse") return;
      this.player.pause();
      this.player.at(u.posToVal(event.clientX - u.over.getBoundingClientRect().left, "x"));
    };
    u.over.addEventListener("pointermove", follow);
    u.over.addEventListener("pointerdown", (event) => event.pointerType !== "mouse" && follow(event));
    holder.resize = () => {
      if (holder.clientWidth && holder.clientWidth !== u.width) u.setSize({ width: holder.clientWidth, height: 190 });
      plot.mark(this.player.index);
    };
    this.sizes.observe(holder);
    figure.plot = plot;
    this.all.push(plot);
    const shown = this.all[0].u.scales.x;
    if (plot !== this.all[0]) u.setScale("x", { min: shown.min, max: shown.max });
    plot.mark(this.player.index);
  }

  // all plots show the same stretch of time
  #zoom(u) {
    const { min, max } = u.scales.x;
    for (const plot of this.all) {
      const other = plot.u.scales.x;
      if (plot.u !== u && (Math.abs(other.min - min) > 1e-9 || Math.abs(other.max - max) > 1e-9)) plot.u.setScale("x", { min, max });
    }
    for (const plot of this.all) plot.mark(this.player.index);
  }

  // the data, and those limits that do not press it flat
  #range(panel, lines) {
    let [low, high] = [Infinity, -Infinity];
    for (const { values } of lines) {
      for (const value of values) {
        if (value < low) low = value;
        if (value > high) high = value;
      }
    }
    if (!(low <= high)) [low, high] = [-1, 1];
    // what hardly moves is drawn as what it is, not as noise
    const largest = Math.max(0, ...panel.limits.flatMap((limit) => [limit.low, limit.high]).map((end) => Math.abs(end ?? 0)));
    const size = Math.max(high - low, 0.01, 0.02 * largest);
    let [bottom, top] = [low, high];
    panel.beyond = [];
    for (const limit of panel.limits) {
      for (const end of [limit.low, limit.high]) {
        if (end === null) continue;
        if (end > high + 1.2 * size || end < low - 1.2 * size) panel.beyond.push([limit, end]);
        else [bottom, top] = [Math.min(bottom, end), Math.max(top, end)];
      }
    }
    this.#beyond(panel);
    const pad = 0.08 * (top - bottom) + (high - low < size ? size / 2 : 0);
    return [bottom - pad, top + pad];
  }

  #caption(panel, lines) {
    const keys = lines.length > 1 || lines[0].keyed
      ? lines.map(({ label, colour, dash }) => SSM.element("span", { class: "key" }, SSM.swatch(colour, dash), label)) : [];
    const drawn = panel.limits.length > 0 ? [SSM.element("span", { class: "key" }, SSM.swatch("#5b6470", [4, 3], 1.5), "limit")] : [];
    panel.note = SSM.element("span", { class: "note" }, panel.missing.join("; "));
    return SSM.element("figcaption", {}, SSM.element("strong", {}, `${panel.title} (${panel.unit})`), ...keys, ...drawn, panel.note);
  }

  #beyond(panel) {
    const words = [];
    for (const limit of panel.limits) {
      const ends = panel.beyond.filter(([which]) => which === limit).map(([, end]) => end);
      const other = [limit.low, limit.high].filter((end) => end !== null && !ends.includes(end));
      if (!ends.length || (other.length && other[0] === -ends[0])) continue;
      const both = ends.length === 2 && ends[0] === -ends[1];
      const name = limit.name === "nominal torque" ? "nominal " : panel.series.length > 1 ? `${limit.of} ` : "";
      words.push(name + (both ? `±${SSM.short(ends[1])}` : ends.map(SSM.short).join(" and ")));
    }
    const text = words.length ? `limits beyond the axis: ${words.join(", ")} ${panel.unit}` : "";
    panel.note.textContent = [...panel.missing, text].filter(Boolean).join("; ");
  }
};

SSM.short = (value) => String(Number(value.toPrecision(4))).replace("-", "−");

SSM.axis = (label, size, unit = "") => ({
  size,
  stroke: "#333b45",
  font: "12px system-ui, sans-serif",
  grid: { stroke: "#e3e7ec", width: 1 },
  ticks: { stroke: "#c3cad3", width: 1, size: 4 },
  label: label || undefined,
  labelSize: label ? 18 : 0,
  labelFont: "12px system-ui, sans-serif",
  values: (u, splits) => splits.map((v, i) => SSM.short(v) + (unit && i === splits.length - 1 ? ` ${unit}` : "")),
});

SSM.shade = (u, phases) => {
  const { ctx } = u;
  const { left, top, width, height } = u.bbox;
  const ratio = window.devicePixelRatio || 1;
  ctx.save();
  ctx.font = `${11 * ratio}px system-ui, sans-serif`;
  ctx.textAlign = "center";
  phases.forEach((phase, i) => {
    const from = Math.max(left, u.valToPos(phase.start, "x", true));
    const to = Math.min(left + width, u.valToPos(phase.end, "x", true));
    if (to <= from) return;
    ctx.fillStyle = i % 2 ? "#eef1f5" : "#ffffff";
    ctx.fillRect(from, top, to - from, height);
    ctx.fillStyle = "#4a525c";
    if (ctx.measureText(phase.name).width < to - from) ctx.fillText(phase.name, (from + to) / 2, top - 4 * ratio);
  });
  ctx.restore();
};

// limits dashed; where one is active a thick stroke on it, with its name
SSM.drawLimits = (u, panel, colours) => {
  const { ctx } = u;
  const { left, top, width, height } = u.bbox;
  const ratio = window.devicePixelRatio || 1;
  ctx.save();
  ctx.beginPath();
  ctx.rect(left, top, width, height);
  ctx.clip();
  ctx.strokeStyle = "#5b6470";
  ctx.lineWidth = 1.2 * ratio;
  for (const limit of panel.limits) {
    ctx.setLineDash(limit.name === "nominal torque" ? [1.5 * ratio, 3 * ratio] : [5 * ratio, 4 * ratio]);
    for (const end of [limit.low, limit.high]) {
      if (end === null) continue;
      const y = u.valToPos(end, "y", true);
      ctx.beginPath();
      ctx.moveTo(left, y);
      ctx.lineTo(left + width, y);
      ctx.stroke();
    }
  }
  ctx.setLineDash([]);
  ctx.font = `600 ${10.5 * ratio}px system-ui, sans-serif`;
  ctx.lineCap = "butt";
  ctx.textAlign = "left";
  const rows = new Map();
  for (const stretch of panel.active) {
    const level = u.valToPos(stretch.value, "y", true);
    const key = `${Math.round(level)}`;
    if (!rows.has(key)) rows.set(key, []);
    const row = rows.get(key);
    if (!row.includes(stretch.label)) row.push(stretch.label);
    const y = level + stretch.side * (3 + 13 * row.indexOf(stretch.label)) * ratio;
    const from = u.valToPos(stretch.start, "x", true);
    const to = Math.max(u.valToPos(stretch.end, "x", true), from + 3 * ratio);
    ctx.strokeStyle = colours[stretch.joint];
    ctx.lineWidth = 4 * ratio;
    ctx.beginPath();
    ctx.moveTo(from, y);
    ctx.lineTo(to, y);
    ctx.stroke();
    const room = Math.min(to, left + width) - Math.max(from, left);
    if (ctx.measureText(stretch.label).width + 6 * ratio > room) continue;
    ctx.lineWidth = 3 * ratio;
    ctx.strokeStyle = "rgba(255, 255, 255, 0.9)";
    ctx.fillStyle = colours[stretch.joint];
    ctx.textBaseline = stretch.side > 0 ? "top" : "bottom";
    const place = [Math.max(from, left) + 3 * ratio, y + stretch.side * 3 * ratio];
    ctx.strokeText(stretch.label, ...place);
    ctx.fillText(stretch.label, ...place);
  }
  ctx.restore();
};
