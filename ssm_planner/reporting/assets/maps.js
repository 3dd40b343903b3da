// Motor torque against speed inside the motor's regions.
"use strict";
SSM.maps = (container, data, channels, player) => {
  if (!data.maps.length) return;
  const grid = element("div", { class: "grid" });
  SSM.section(container, "Motor torque against speed", grid, true);
  for (const map of data.maps) SSM.map(grid, map, data, channels, player);
};

SSM.map = (grid, map, data, channels, player) => {
  const speed = channels[`w${map.joint}`].map((x) => (x * 30) / Math.PI);
  const torque = channels[`tau${map.joint}`].map((x) => 1000 * x);
  const holder = element("div", { class: "plot", role: "img", "aria-label": `Motor torque against speed of ${data.joints[map.joint].name}` });
  const colour = data.colours[map.joint];
  const notes = [];
  const span = (values, largest, unit) => {
    const reach = Math.max(...values.map(Math.abs), 1e-9);
    if (largest > 6 * reach) notes.push(`to ${short(largest)} ${unit}`);
    const end = largest > 6 * reach ? 1.6 * reach : 1.08 * Math.max(largest, reach);
    return [Math.min(...values) < -1e-9 ? -end : -0.06 * end, Math.max(...values) > 1e-9 ? end : 0.06 * end];
  };
  const ranges = { x: span([...speed], map.speed.at(-1), "rpm"), y: span([...torque], Math.max(...map.largest), "mN·m") };
  const beyond = notes.length ? `regions reach ${notes.join(" and ")}` : "";
  const key = (swatch, text) => element("span", { class: "key" }, swatch, text);
  const square = (fill) => {
    const node = element("span", { class: "square" });
    node.style.background = `light-dark(${SSM.inks[0].regions[fill]}, ${SSM.inks[1].regions[fill]})`;
    return node;
  };
  const value = element("span", { class: "value" });
  const caption = element("figcaption", {}, element("strong", {}, data.joints[map.joint].name),
    element("span", {}, `${map.motor}${map.placeholder ? " (placeholder figures)" : ""}`),
    key(SSM.swatch(colour, []), "motion"), value, key(square(1), "continuous"), key(square(0), "short term"),
    element("span", { class: "note" }, beyond));
  grid.append(element("figure", {}, caption, holder));
  const dot = element("div", { class: "dot" });
  const draw = (u) => {
    SSM.region(u, map.speed, map.largest, ink("regions")[0]);
    SSM.region(u, map.speed, map.continuous, ink("regions")[1]);
  };
  const u = new uPlot({
    width: Math.max(200, holder.clientWidth), height: 230, padding: [10, 14, 0, 0], legend: { show: false }, cursor: { show: false },
    scales: { x: { time: false, range: () => ranges.x }, y: { range: () => ranges.y } },
    axes: [SSM.axis("motor speed (rpm)", 34), SSM.axis("motor torque (mN·m)", 48)],
    series: [{}, { show: true, points: { show: false }, paths: () => null }],
    hooks: { drawClear: [draw], draw: [(plot) => SSM.curve(plot, speed, torque, SSM.tone(colour))] },
  }, [ranges.x, [null, null]], holder);
  u.over.append(dot);
  const mark = (index) => {
    dot.style.transform = `translate(${u.valToPos(speed[index], "x")}px, ${u.valToPos(torque[index], "y")}px)`;
    value.textContent = `${fixed(torque[index], 3)} mN·m at ${fixed(speed[index], 0)} rpm`;
  };
  player.listen(mark);
  const fit = () => SSM.fit(u, holder, 230);
  SSM.whenRedrawn(fit);
  new ResizeObserver(() => {
    fit();
    mark(player.index);
  }).observe(holder);
};

// all four quadrants
SSM.region = (u, speed, torque, fill) => {
  SSM.clip(u);
  u.ctx.fillStyle = fill;
  u.ctx.strokeStyle = ink("limit");
  const ways = [[1, 1], [1, -1], [-1, -1], [-1, 1]];
  u.ctx.beginPath();
  ways.forEach(([x, y], quadrant) => {
    const order = speed.map((_, i) => (quadrant % 2 ? speed.length - 1 - i : i));
    order.forEach((i) => u.ctx.lineTo(u.valToPos(x * speed[i], "x", true), u.valToPos(y * torque[i], "y", true)));
  });
  u.ctx.closePath();
  u.ctx.fill();
  u.ctx.stroke();
  u.ctx.restore();
};

SSM.curve = (u, x, y, colour) => {
  u.ctx.save();
  u.ctx.strokeStyle = colour;
  u.ctx.lineWidth = 1.8 * devicePixelRatio;
  u.ctx.lineJoin = "round";
  u.ctx.beginPath();
  for (let i = 0; i < x.length; i++) u.ctx.lineTo(u.valToPos(x[i], "x", true), u.valToPos(y[i], "y", true));
  u.ctx.stroke();
  u.ctx.restore();
};
