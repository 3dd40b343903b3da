// Two motions over each other, plans A and B or planned and simulated: the first solid and dark, the second dashed.
"use strict";
(() => {
  const data = SSM.data();
  const channels = data.channels.map(SSM.channels);
  const times = channels[0].t;
  const names = data.names ?? ["A", "B"];
  const player = new SSM.Player(document.getElementById("player"), times, []);
  player.listen(SSM.cells(data, (name, channel) => channels[names.indexOf(name)][channel]));
  const plots = new SSM.Plots(document.getElementById("plots"), player, data.colours, []);
  for (const panel of data.panels) {
    plots.add(panel, times, () => panel.sides.map((side) => ({
      label: names[side], colour: data.colours[side], dash: SSM.dashes[side], keyed: true,
      values: Array.from(channels[side][panel.channel], (x, i) => (times[i] <= data.ends[side] + 1e-9 ? x * panel.scale : null)),
    })));
  }
  requestAnimationFrame(() => setTimeout(() => {
    const robots = data.scenes.map((scene, side) => ({ scene, colours: data.colours, ghost: side === 1,
      path: Float32Array.from({ length: 3 * times.length }, (_, i) => channels[side][`tip${i % 3}`][Math.floor(i / 3)]) }));
    const scene = new SSM.Scene(document.getElementById("scene"), robots);
    const q = (side, index) => [0, 1, 2, 3].map((i) => channels[side][`q${i}`][index]);
    player.listen((index) => names.forEach((_, side) => scene.pose(side, q(side, index))));
    if (scene.views.eye) scene.look("eye");
    Object.assign(SSM, { player, scene, channels, ready: performance.now() });
  }));
})();
