// Compare two motions in one scene and in common plots: plans A and B, or the planned and the simulated motion.
// The first one is solid and dark, the second one is dashed.
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
      path: SSM.tipPath(channels[side]) }));
    const scene = new SSM.Scene(byId("scene"), robots);
    player.listen((index) => channels.forEach((samples, side) => scene.pose(side, SSM.joints(samples, index))));
    Object.assign(SSM, { player, scene, channels, ready: performance.now() });
  }));
})();
