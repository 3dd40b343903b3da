// Two motions over each other, plans A and B or planned and simulated: the first solid and dark, the second dashed.
"use strict";
(() => {
  const data = SSM.data();
  const channels = data.channels.map(SSM.channels);
  const times = channels[0].t;
  const names = data.names ?? ["A", "B"];
  const player = new SSM.Player(byId("player"), times, []);
  player.listen(SSM.cells(data, (name, channel) => channels[names.indexOf(name)][channel]));
  const plots = new SSM.Plots(byId("plots"), player, data.colours, []);
  SSM.overlay(plots, data, channels, names);
  requestAnimationFrame(() => setTimeout(() => {
    const robots = data.scenes.map((scene, side) => ({ scene, colours: data.colours, ghost: side === 1,
      path: SSM.trace(channels[side]) }));
    const scene = new SSM.Scene(byId("scene"), robots);
    player.listen((index) => channels.forEach((each, side) => scene.pose(side, SSM.joints(each, index))));
    Object.assign(SSM, { player, scene, channels, ready: performance.now() });
  }));
})();
