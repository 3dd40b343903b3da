// Plots over time with limits, intervals of active limits and phases. The pointer moves the time slider, and each plot shows its values
// at that instant.
"use strict";
SSM.Plots = class {
  // `folded` is a pattern of the titles of sections that are closed at first.
  constructor(container, player, colours, phases, folded = /^(Joints|Motors|Part|Steady)/) {
    Object.assign(this, { container, player, colours, phases, folded, all: [], section: null });
    this.sizes = new ResizeObserver((entries) => entries.forEach(({ target }) => target.resize?.()));
    this.seen = new IntersectionObserver((entries) => entries.forEach(({ target, isIntersecting }) => {
      if (isIntersecting && target.build) target.build();
      if (!target.plot) return;
      target.plot.visible = isIntersecting;
      target.plot.mark(player.index);
    }), { rootMargin: "300px" });
    SSM.onRedraw(() => {
      if (SSM.isPrinting) {
        document.querySelectorAll("details:not(.licences)").forEach((each) => { each.open = true; });
        container.querySelectorAll("figure").forEach((figure) => figure.build?.());
      }
      for (const { u, holder } of this.all) SSM.resizePlot(u, holder);
    });
    player.listen((index) => this.all.forEach((plot) => plot.visible && plot.mark(index)));
  }

  // Add the plot of a panel (see html/panels.py). lines() returns its curves as [{label, colour, dash, values}].
  // The plot is drawn when it comes near the window.
  add(panel, times, lines) {
    if (panel.section !== this.section) this.open(panel.section);
    const figure = element("figure", {}, element("div", { class: "plot", role: "img", "aria-label": panel.title }));
    this.grid.append(figure);
    figure.build = () => {
      figure.build = null;
      this.#build(figure, panel, times, lines());
    };
    this.seen.observe(figure);
  }

  #build(figure, panel, times, lines) {
    const holder = figure.firstChild;
    const extremes = lines.map(({ values }) => SSM.extremes(values));
    const range = this.#range(panel, extremes);
    const options = {
      width: Math.max(200, holder.clientWidth),
      height: SSM.height(holder),
      padding: [14, 10, 0, 0],
      pxAlign: 0, // lines between pixels: smooth on screens of normal density too
      legend: { show: false },
      cursor: { y: false, points: { show: false }, drag: { x: true, y: false } },
      scales: { x: { time: false }, y: { range } },
      axes: [SSM.axis("", 34, "s"), SSM.axis("", SSM.axisWidth)],
      series: [{}, ...lines.map(({ colour, dash, label }) => (
        { stroke: () => SSM.canvasColour(colour), width: 1.8, dash, label, pxAlign: 0, points: { show: false } }))],
      hooks: {
        drawClear: [(u) => SSM.shadePhases(u, this.phases)],
        draw: [(u) => SSM.drawLimits(u, panel, this.colours)],
        setScale: [(u, key) => key === "x" && this.#zoom(u)],
      },
    };
    const u = new uPlot(options, [times, ...lines.map(({ values }) => values)], holder);
    const keys = lines.map((line, i) => this.#key(u, line, i, lines.length > 1 || line.keyed));
    const reset = element("button", { type: "button", class: "tool", hidden: true,
      onclick: () => u.setScale("x", { min: times[0], max: times.at(-1) }) }, "Reset zoom");
    holder.before(this.#caption(panel, keys, reset, figure, holder));
    holder.setAttribute("aria-label", SSM.describePlot(panel, lines, extremes));
    this.#attach(u, holder, figure, keys, reset);
  }

  // Create the legend entry of one curve: swatch, name and value. It is a button that shows or hides the curve.
  #key(u, { colour, dash, label, values }, i, named) {
    const value = element("span", { class: "value" });
    const mark = (index) => SSM.setText(value, Number.isFinite(values[index]) ? short(values[index]) : "–");
    if (!named) return { node: element("span", { class: "key" }, value), mark };
    const node = element("button", { type: "button", class: "key", "aria-pressed": "true", title: `Show or hide ${label}`, onclick: () => {
      const show = node.getAttribute("aria-pressed") === "false";
      node.setAttribute("aria-pressed", String(show));
      u.setSeries(i + 1, { show });
    } }, SSM.swatch(colour, dash), label, value);
    return { node, mark };
  }

  open(section) {
    this.section = section;
    this.grid = element("div", { class: "grid" });
    SSM.addSection(this.container, section, this.grid, this.folded.test(section));
  }

  // Add notes at the end of a section, which is created if it does not exist yet.
  note(section, words) {
    if (!words.length) return;
    if (section !== this.section) this.open(section);
    this.grid.after(...words.map((text) => element("p", { class: "note" }, text)));
  }

  #attach(u, holder, figure, keys, reset) {
    const line = element("div", { class: "instant" });
    u.over.append(line);
    const plot = { u, holder, reset, visible: true, mark: (index) => {
      const x = u.valToPos(this.player.times[index], "x");
      line.style.transform = `translateX(${x}px)`;
      line.style.display = x < -1 || x > u.bbox.width / devicePixelRatio + 1 ? "none" : "block";
      for (const key of keys) key.mark(index);
    } };
    const follow = (event) => {
      if (event.buttons && event.pointerType === "mouse") return;
      this.player.pause();
      this.player.at(u.posToVal(event.clientX - u.over.getBoundingClientRect().left, "x"));
    };
    u.over.addEventListener("pointermove", follow);
    u.over.addEventListener("pointerdown", (event) => event.pointerType !== "mouse" && follow(event));
    holder.resize = () => {
      if (!SSM.isPrinting && holder.clientWidth) SSM.resizePlot(u, holder);
      plot.mark(this.player.index);
    };
    this.sizes.observe(holder);
    figure.plot = plot;
    this.all.push(plot);
    const shown = this.all[0].u.scales.x;
    if (plot !== this.all[0]) u.setScale("x", { min: shown.min, max: shown.max });
    plot.mark(this.player.index);
  }

  // Let all plots show the same range of times.
  #zoom(u) {
    const { min, max } = u.scales.x;
    const { times } = this.player;
    for (const plot of this.all) {
      const other = plot.u.scales.x;
      if (plot.u !== u && (other.min !== min || other.max !== max)) plot.u.setScale("x", { min, max });
      plot.reset.hidden = min <= times[0] && max >= times.at(-1);
    }
    for (const plot of this.all) plot.mark(this.player.index);
  }

  // Return the range of the vertical axis: the data, and the limits that are close enough to keep the curve readable.
  // Other limits are listed in `panel.outside`.
  #range(panel, extremes) {
    let low = Math.min(...extremes.map(([smallest]) => smallest));
    let high = Math.max(...extremes.map(([, largest]) => largest));
    if (!(low <= high)) [low, high] = [-1, 1];
    // The range is never smaller than `size`, so that a nearly constant quantity does not look like noise.
    const largest = Math.max(0, ...panel.limits.flatMap(SSM.finiteBounds).map(Math.abs));
    const size = Math.max(high - low, 0.01, 0.02 * largest);
    let [bottom, top] = [low, high];
    panel.outside = [];
    for (const limit of panel.limits) {
      for (const end of SSM.finiteBounds(limit)) {
        if (end > high + 1.2 * size || end < low - 1.2 * size) panel.outside.push([limit, end]);
        else [bottom, top] = [Math.min(bottom, end), Math.max(top, end)];
      }
    }
    const pad = 0.08 * (top - bottom) + (high - low < size ? size / 2 : 0);
    return [bottom - pad, top + pad];
  }

  #caption(panel, keys, reset, figure, holder) {
    const inside = panel.outside.length < panel.limits.flatMap(SSM.finiteBounds).length;
    const drawn = inside ? [element("span", { class: "key" }, SSM.swatch("#5b6470", [4, 3], 1.5), panel.active.length ? "limit, hatched where active" : "limit")] : [];
    const larger = element("button", { type: "button", class: "tool", "aria-pressed": "false", "aria-label": `Enlarge ${panel.title}`, onclick: () => {
      larger.setAttribute("aria-pressed", String(figure.classList.toggle("large")));
      holder.resize();
    } }, "⤢");
    const note = [...panel.missing, SSM.describeOutsideLimits(panel)].filter(Boolean).join("; ");
    return element("figcaption", {}, element("strong", {}, panel.unit ? `${panel.title} (${panel.unit})` : panel.title), ...keys.map(({ node }) => node),
      ...drawn, element("span", { class: "note" }, note), element("span", { class: "tools" }, reset, larger));
  }
};

// Add a heading with its content. A folded section opens at a click.
SSM.addSection = (container, title, content, folded) => {
  const heading = element("h2", {}, title);
  container.append(...(folded ? [element("details", { class: "fold" }, element("summary", {}, heading), content)] : [heading, content]));
};

SSM.finiteBounds = ({ low, high }) => [low, high].filter((end) => end !== null);

// Set the size of a plot to the width of its holder, or to that of paper.
SSM.resizePlot = (u, holder, height = SSM.height(holder)) => u.setSize({ width: SSM.isPrinting ? 680 : Math.max(200, holder.clientWidth), height });

SSM.height = (holder) => (holder.closest(".large") && !SSM.isPrinting ? 420 : innerWidth > 860 ? 190 : 150);

// Describe a plot for readers who do not see it.
SSM.describePlot = (panel, lines, extremes) => {
  const { unit } = panel;
  const drawn = lines.map(({ label }, i) => `${label} between ${short(extremes[i][0])} and ${short(extremes[i][1])} ${unit}`);
  const limits = panel.limits.map((limit) => `${limit.label}: ${SSM.finiteBounds(limit).map(short).join(" to ")} ${unit}`);
  const active = panel.active.map(({ label, start, end }) => `${label} from ${start.toFixed(3)} to ${end.toFixed(3)} s`);
  return `${panel.title} over time. ${drawn.join("; ")}.${limits.length ? ` Limits: ${limits.join("; ")}.` : ""}` +
    (active.length ? ` Active: ${active.join("; ")}.` : "");
};

// Describe the limits that are outside of the range of a plot.
SSM.describeOutsideLimits = (panel) => {
  const words = [];
  for (const limit of panel.limits) {
    const ends = panel.outside.filter(([which]) => which === limit).map(([, end]) => end);
    const other = SSM.finiteBounds(limit).filter((end) => !ends.includes(end));
    if (!ends.length || (other.length && other[0] === -ends[0])) continue;
    const both = ends.length === 2 && ends[0] === -ends[1];
    const name = limit.name === "nominal torque" ? "nominal " : panel.series.length > 1 ? `${limit.of} ` : "";
    words.push(name + (both ? `±${short(ends[1])}` : ends.map(short).join(" and ")));
  }
  return words.length ? `limits outside the axis: ${words.join(", ")} ${panel.unit}` : "";
};

const short = (value) => (Math.abs(value) < 1e-9 ? "0" : rounded(value, 4));

// Return the width of a vertical axis, so that its longest number fits.
SSM.axisWidth = (u, values) => Math.max(52, ...(values ?? []).map((text) => 1.1 * SSM.textMeasure.measureText(text).width + 14));

SSM.axis = (label, size, unit = "") => ({
  size,
  stroke: () => themeColour("text"),
  font: "12px system-ui, sans-serif",
  label: label || undefined,
  labelSize: label ? 18 : 0,
  labelFont: "12px system-ui, sans-serif",
  grid: { stroke: () => themeColour("grid"), width: 1 },
  ticks: { stroke: () => themeColour("tick"), width: 1, size: 4 },
  values: (u, splits) => splits.map((v, i) => short(v) + (unit && i === splits.length - 1 ? ` ${unit}` : "")),
});

SSM.shadePhases = (u, phases) => {
  const { ctx } = u;
  const { left, top, width, height } = u.bbox;
  const ratio = devicePixelRatio;
  ctx.save();
  ctx.font = `${11 * ratio}px system-ui, sans-serif`;
  ctx.textAlign = "center";
  phases.forEach((phase, i) => {
    const from = Math.max(left, u.valToPos(phase.start, "x", true));
    const to = Math.min(left + width, u.valToPos(phase.end, "x", true));
    if (to <= from) return;
    ctx.fillStyle = themeColour(i % 2 ? "stripe" : "paper");
    ctx.fillRect(from, top, to - from, height);
    ctx.fillStyle = themeColour("text");
    ctx.fillText(SSM.fitPhaseName(phase.name, (to - from) / ratio), (from + to) / 2, top - 4 * ratio);
  });
  ctx.restore();
};

// Restrict drawing to the area inside the axes until the context is restored.
SSM.clipToAxes = ({ ctx, bbox: { left, top, width, height } }) => {
  ctx.save();
  ctx.beginPath();
  ctx.rect(left, top, width, height);
  ctx.clip();
};

// Draw limits as dashed lines. While a limit is active, hatching marks the forbidden side.
SSM.drawLimits = (u, panel, colours) => {
  const { ctx } = u;
  const { left, width } = u.bbox;
  const ratio = devicePixelRatio;
  SSM.clipToAxes(u);
  ctx.lineWidth = 1.2 * ratio;
  for (const limit of panel.limits) {
    ctx.strokeStyle = limit.side in colours ? SSM.canvasColour(colours[limit.side]) : themeColour("limit");
    ctx.setLineDash(limit.name === "nominal torque" ? [1.5 * ratio, 3 * ratio] : [5 * ratio, 4 * ratio]);
    for (const end of SSM.finiteBounds(limit)) {
      const y = u.valToPos(end, "y", true);
      ctx.beginPath();
      ctx.moveTo(left, y);
      ctx.lineTo(left + width, y);
      ctx.stroke();
    }
  }
  ctx.setLineDash([]);
  ctx.lineWidth = 1.8 * ratio;
  // If several joints are at one limit, their hatching alternates in the colours of the joints.
  const joints = [...new Set(panel.active.map(({ joint }) => joint))];
  const [pitch, size] = [5 * ratio, 7 * ratio];
  for (const interval of panel.active) {
    const y = u.valToPos(interval.value, "y", true);
    const from = u.valToPos(interval.start, "x", true);
    const to = Math.max(u.valToPos(interval.end, "x", true), from + 3 * ratio);
    ctx.strokeStyle = SSM.canvasColour(colours[interval.joint]);
    ctx.beginPath();
    ctx.moveTo(from, y);
    ctx.lineTo(to, y);
    for (let x = from + pitch * joints.indexOf(interval.joint); x <= to; x += pitch * joints.length) {
      ctx.moveTo(x, y);
      ctx.lineTo(x + size / 2, y - interval.side * size);
    }
    ctx.stroke();
  }
  ctx.restore();
};
