// What holds at the shown instant: joints, motors, task coordinates, active limits.
"use strict";
// cells of the template: data-channel (a side, if there are two, and a channel), data-scale and data-digits; data-joint has a swatch
SSM.cells = (data, find) => {
  for (const node of document.querySelectorAll("[data-joint]")) {
    const { joint } = node.dataset;
    node.prepend(SSM.swatch(data.colours[joint], SSM.dashes[joint]), " ");
  }
  const cells = [...document.querySelectorAll("[data-channel]")].map((node) => ({ node, values: find(...node.dataset.channel.split(" ")) }))
    .filter(({ values }) => values);
  return (index) => {
    for (const { node, values } of cells) SSM.say(node, fixed(node.dataset.scale * values[index], node.dataset.digits));
  };
};

SSM.active = (container, data, times) => {
  const stretches = data.panels.flatMap((panel) => panel.active);
  let said = null;
  return (index) => {
    const t = times[index];
    const names = [...new Set(stretches.filter((s) => t >= s.start - 1e-9 && t <= s.end + 1e-9).map((s) => s.label))];
    const text = names.join(";");
    if (text === said) return;
    said = text;
    const chips = names.map((name) => element("span", { class: "chip" }, name));
    container.replaceChildren("Active limits: ", ...(chips.length ? chips : ["none"]));
  };
};

// rows of all limits that become active, with bars where they are
SSM.timeline = (container, data, player) => {
  const end = data.duration;
  const percent = (t) => `${(100 * t) / end}%`;
  const bar = (text, start, stop, kind, colour) => {
    const node = element("span", { class: kind, title: `${text}: ${start.toFixed(3)}–${stop.toFixed(3)} s` });
    node.style.left = percent(start);
    node.style.width = `max(3px, ${percent(stop - start)})`;
    node.style.background = SSM.paint(colour);
    return node;
  };
  const row = (name, bars, said) => {
    const cursor = SSM.cursor();
    const track = element("div", { class: "track", role: "img", "aria-label": `${name}: active ${said}`, onpointerdown: (event) => player.point(event),
      onpointermove: (event) => event.pointerType === "mouse" && player.point(event) }, ...bars, cursor.node);
    cursors.push(cursor);
    return element("div", { class: "row" }, element("span", { class: "name" }, name), track);
  };
  const cursors = [];
  const groups = new Map();
  for (const stretch of data.panels.flatMap((panel) => panel.active)) {
    groups.set(stretch.label, [...(groups.get(stretch.label) ?? []), stretch]);
  }
  const rows = [...groups].map(([label, list]) => row(label, list.map((s) => bar(label, s.start, s.end, "bar", data.colours[s.joint])),
    list.map((s) => `${s.start.toFixed(3)} to ${s.end.toFixed(3)} s`).join(", ")));
  const none = groups.size ? [] : [element("p", {}, "No limit is approached within 0.5 %.")];
  container.replaceChildren(element("h2", {}, "Active limits over time"), element("div", { class: "timeline" }, ...rows), ...none);
  player.listen((index) => {
    for (const cursor of cursors) cursor.at(player.times[index] / end);
  });
};
