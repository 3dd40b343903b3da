// Set up the report of one plan: time slider, plots, tables and 3D view.
"use strict";
(() => {
  const data = SSM.data();
  const channels = SSM.channels(data.channels);
  const times = channels.t;
  const player = new SSM.Player(byId("player"), times, data.phases);
  player.listen(SSM.cells(data, (name) => channels[name]));
  player.listen(SSM.showActiveLimits(document.querySelector(".chips"), data, times));
  SSM.timeline(byId("active"), data, player);
  const plots = new SSM.Plots(byId("plots"), player, data.colours, data.phases);
  for (const panel of data.panels) {
    plots.add(panel, times, () => panel.series.map(({ channel, label, joint }) => ({
      label, colour: data.colours[joint], dash: SSM.dashes[joint], values: channels[channel].map((x) => x * panel.scale),
    })));
  }
  SSM.addMotorMaps(byId("plots"), data, channels, player);
  for (const [section, notes] of Object.entries(data.notes)) plots.note(section, notes);
  document.querySelectorAll("table.sortable").forEach(SSM.sortable);
  SSM.linkTimeButtons(player);
  player.tool("Save CSV", () => SSM.download("motion.csv", SSM.csv(data, channels), "text/csv"));
  // The 3D view starts after the first drawing, so that the page is readable before.
  requestAnimationFrame(() => setTimeout(() => {
    const scene = new SSM.Scene(byId("scene"), [{ scene: data.scene, colours: data.colours, path: SSM.tipPath(channels), stops: data.stops,
      begin: SSM.joints(channels, 0) }]);
    player.listen((index) => scene.pose(0, SSM.joints(channels, index)));
    player.scene = scene;
    player.address();
    scene.controls?.addEventListener("change", () => player.address());
    if (scene.renderer) player.tool("Save picture", () => scene.picture());
    Object.assign(SSM, { player, scene, channels, ready: performance.now() });
    if (!player.linked() && !SSM.prefersReducedMotion) player.toggle();
  }));
})();
