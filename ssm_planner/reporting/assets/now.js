// Show the values at the shown instant: joints, motors, task coordinates and active limits.
"use strict";
// Return a function that writes the values at an instant into the cells of the template. The attribute data-channel of a cell contains
// the name of the motion, if there are two, and the channel. Its value is multiplied by data-scale and shown with data-digits digits.
// An element with data-joint gets a short line in the colour of this joint.
SSM.cells = (data, find) => {
  for (const node of document.querySelectorAll("[data-joint]")) {
    const { joint } = node.dataset;
    node.prepend(SSM.swatch(data.colours[joint], SSM.dashes[joint]), " ");
  }
  const cells = [...document.querySelectorAll("[data-channel]")].map((node) => ({ node, values: find(...node.dataset.channel.split(" ")) }))
    .filter(({ values }) => values);
  return (index) => {
    for (const { node, values } of cells) SSM.setText(node, fixed(node.dataset.scale * values[index], node.dataset.digits));
  };
};

// Return a function that lists the limits that are active at an instant.
SSM.showActiveLimits = (container, data, times) => {
  const intervals = data.panels.flatMap((panel) => panel.active);
  let shownText = null;
  return (index) => {
    const t = times[index];
    const names = [...new Set(intervals.filter((s) => t >= s.start - 1e-9 && t <= s.end + 1e-9).map((s) => s.label))];
    const text = names.join(";");
    if (text === shownText) return;
    shownText = text;
    const chips = names.map((name) => element("span", { class: "chip" }, name));
    container.replaceChildren("Active limits: ", ...(chips.length ? chips : ["none"]));
  };
};

// Draw one row for each limit that becomes active, with a bar for each interval in which it is active.
SSM.timeline = (container, data, player) => {
  const end = data.duration;
  const bar = (interval) => {
    const node = SSM.bar("bar", interval.label, interval, 0, end);
    node.style.background = SSM.cssColour(data.colours[interval.joint]);
    return node;
  };
  const row = (name, bars, intervalsText) => {
    const cursor = SSM.cursor();
    const track = element("div", { class: "track", role: "img", "aria-label": `${name}: active ${intervalsText}`, onpointerdown: (event) => player.point(event),
      onpointermove: (event) => event.pointerType === "mouse" && player.point(event) }, ...bars, cursor.node);
    cursors.push(cursor);
    return element("div", { class: "row" }, element("span", { class: "name" }, name), track);
  };
  const cursors = [];
  const groups = new Map();
  for (const interval of data.panels.flatMap((panel) => panel.active)) {
    groups.set(interval.label, [...(groups.get(interval.label) ?? []), interval]);
  }
  const rows = [...groups].map(([label, list]) => row(label, list.map(bar),
    list.map((s) => `${s.start.toFixed(3)} to ${s.end.toFixed(3)} s`).join(", ")));
  const none = groups.size ? [] : [element("p", {}, "No limit is approached within 0.5 %.")];
  container.replaceChildren(element("h2", {}, "Active limits over time"), element("div", { class: "timeline" }, ...rows), ...none);
  player.listen((index) => {
    for (const cursor of cursors) cursor.at(player.times[index] / end);
  });
};
