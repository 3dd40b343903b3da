// Plot the motor torque against the speed, inside the operating regions of the motor.
"use strict";
SSM.addMotorMaps = (container, data, channels, player) => {
  if (!data.maps.length) return;
  const grid = element("div", { class: "grid" });
  SSM.addSection(container, "Motor torque against speed", grid, true);
  for (const map of data.maps) SSM.addMotorMap(grid, map, data, channels, player);
};

// Add the map of one motor: its regions, the density of the motion over time, and a dot at the shown instant.
SSM.addMotorMap = (grid, map, data, channels, player) => {
  const joint = data.joints[map.joint];
  const speed = channels[`w${map.joint}`].map((x) => (x * 30) / Math.PI);
  const torque = channels[`tau${map.joint}`].map((x) => 1000 * x);
  const holder = element("div", { class: "plot", role: "img", "aria-label": `Motor torque against speed of ${joint.name}` });
  const colour = data.colours[map.joint];
  const notes = [];
  const axisRange = (values, largest, unit) => {
    const extent = Math.max(...values.map(Math.abs), 1e-9);
    if (largest > 6 * extent) notes.push(`to ${short(largest)} ${unit}`);
    const end = largest > 6 * extent ? 1.6 * extent : 1.08 * Math.max(largest, extent);
    return [Math.min(...values) < -1e-9 ? -end : -0.06 * end, Math.max(...values) > 1e-9 ? end : 0.06 * end];
  };
  const ranges = { x: axisRange([...speed], map.speed.at(-1), "rpm"), y: axisRange([...torque], Math.max(...map.largest), "mN·m") };
  const key = (swatch, text) => element("span", { class: "key" }, swatch, text);
  const square = (fill) => {
    const node = element("span", { class: "square" });
    node.style.background = `light-dark(${SSM.themes[0].regions[fill]}, ${SSM.themes[1].regions[fill]})`;
    return node;
  };
  const value = element("span", { class: "value" });
  const caption = element("figcaption", {}, element("strong", {}, joint.name),
    element("span", {}, [`${map.motor}${map.placeholder ? " (placeholder figures)" : ""}`, ...joint.gears].join(" + ")),
    key(SSM.swatch(colour, []), "motion, more solid where it stays longer"), value, key(square(1), "continuous"), key(square(0), "short term"),
    element("span", { class: "note" }, notes.length ? `regions reach ${notes.join(" and ")}` : ""));
  grid.append(element("figure", {}, caption, holder));
  const dot = element("div", { class: "dot" });
  const draw = (u) => {
    SSM.fillRegion(u, map.speed, map.largest, themeColour("regions")[0]);
    SSM.fillRegion(u, map.speed, map.continuous, themeColour("regions")[1]);
  };
  const u = new uPlot({
    width: Math.max(200, holder.clientWidth), height: 230, padding: [10, 14, 0, 0], legend: { show: false }, cursor: { show: false },
    scales: { x: { time: false, range: () => ranges.x }, y: { range: () => ranges.y } },
    axes: [SSM.axis("motor speed (rpm)", 34), SSM.axis("motor torque (mN·m)", 48)],
    series: [{}, { show: true, points: { show: false }, paths: () => null }],
    hooks: { drawClear: [draw], draw: [(plot) => SSM.shadeInstants(plot, speed, torque, SSM.canvasColour(colour))] },
  }, [ranges.x, [null, null]], holder);
  u.over.append(dot);
  const mark = (index) => {
    dot.style.transform = `translate(${u.valToPos(speed[index], "x")}px, ${u.valToPos(torque[index], "y")}px)`;
    value.textContent = `${fixed(torque[index], 3)} mN·m at ${fixed(speed[index], 0)} rpm`;
  };
  player.listen(mark);
  const fit = () => SSM.resizePlot(u, holder, 230);
  SSM.onRedraw(fit);
  new ResizeObserver(() => {
    fit();
    mark(player.index);
  }).observe(holder);
};

// Fill an operating region in all four quadrants. `torque` is its boundary at each speed.
SSM.fillRegion = (u, speed, torque, fill) => {
  SSM.clipToAxes(u);
  u.ctx.fillStyle = fill;
  u.ctx.strokeStyle = themeColour("limit");
  const signs = [[1, 1], [1, -1], [-1, -1], [-1, 1]];
  u.ctx.beginPath();
  signs.forEach(([x, y], quadrant) => {
    const order = speed.map((_, i) => (quadrant % 2 ? speed.length - 1 - i : i));
    order.forEach((i) => u.ctx.lineTo(u.valToPos(x * speed[i], "x", true), u.valToPos(y * torque[i], "y", true)));
  });
  u.ctx.closePath();
  u.ctx.fill();
  u.ctx.stroke();
  u.ctx.restore();
};

// Draw a translucent disc at each instant. The instants are evenly spaced, so the shade shows the density over time.
SSM.shadeInstants = (u, x, y, colour) => {
  u.ctx.save();
  u.ctx.fillStyle = colour;
  u.ctx.globalAlpha = 0.25;
  x.forEach((speed, i) => {
    u.ctx.beginPath();
    u.ctx.arc(u.valToPos(speed, "x", true), u.valToPos(y[i], "y", true), 3 * devicePixelRatio, 0, 7);
    u.ctx.fill();
  });
  u.ctx.restore();
};
