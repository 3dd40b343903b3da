// What holds at the shown instant: joints, motors, task coordinates, active limits.
"use strict";
SSM.now = (container, data, channels) => {
  const degrees = 180 / Math.PI;
  const shown = (joint) => (joint.kind === "revolute" ? { unit: "°", scale: degrees } : { unit: "mm", scale: 1000 });
  const cells = [];
  const cell = (channel, scale, digits) => {
    const node = SSM.element("td", { class: "number", "data-channel": channel });
    if (channel in channels) cells.push({ node, values: channels[channel], scale, digits });
    else node.textContent = "–";
    return node;
  };
  const rows = data.joints.map((joint, i) => {
    const { unit, scale } = shown(joint);
    const name = SSM.element("th", { scope: "row" }, SSM.swatch(data.colours[i], SSM.dashes[i]), ` ${joint.name}, ${unit}`);
    return SSM.element("tr", {}, name, cell(`q${i}`, scale, 3), cell(`qd${i}`, scale, 2), cell(`qdd${i}`, scale, 1),
      cell(`w${i}`, 30 / Math.PI, 0), cell(`tau${i}`, 1000, 3));
  });
  const heads = ["joint", "q", "q̇ /s", "q̈ /s²", "rpm", "mN·m"].map((text) => SSM.element("th", { scope: "col" }, text));
  const joints = SSM.element("table", {}, SSM.element("thead", {}, SSM.element("tr", {}, ...heads)), SSM.element("tbody", {}, ...rows));
  const task = SSM.element("p", { class: "task" });
  const active = SSM.element("p", { class: "chips" });
  container.replaceChildren(SSM.scrolling(joints), task, active);
  const stretches = data.panels.flatMap((panel) => panel.active);
  let said = null;
  return (index) => {
    for (const { node, values, scale, digits } of cells) SSM.say(node, SSM.fixed(scale * values[index], digits));
    const value = (i, scale, digits) => SSM.fixed(scale * channels[`task${i}`][index], digits);
    task.textContent = `roll ${value(0, degrees, 2)}°, tilt ${value(1, degrees, 2)}°, spin ${value(2, degrees, 2)}°, depth ${value(3, 1000, 2)} mm`;
    const t = channels.t[index];
    const names = [...new Set(stretches.filter((s) => t >= s.start - 1e-9 && t <= s.end + 1e-9).map((s) => s.label))];
    const text = names.join(";");
    if (text === said) return;
    said = text;
    const chips = names.map((name) => SSM.element("span", { class: "chip" }, name));
    active.replaceChildren("Active limits: ", ...(chips.length ? chips : ["none"]));
  };
};

// rows of all limits that become active, with bars where they are
SSM.timeline = (container, data, player) => {
  const end = data.duration;
  const percent = (t) => `${(100 * t) / end}%`;
  const bar = (text, start, stop, kind, colour) => {
    const node = SSM.element("span", { class: kind, title: `${text}: ${start.toFixed(3)}–${stop.toFixed(3)} s` });
    node.style.left = percent(start);
    node.style.width = `max(3px, ${percent(stop - start)})`;
    node.style.background = SSM.paint(colour);
    return node;
  };
  const row = (name, bars, said) => {
    const cursor = SSM.cursor();
    const track = SSM.element("div", { class: "track", role: "img", "aria-label": `${name}: active ${said}`, onpointerdown: (event) => follow(event, track),
      onpointermove: (event) => event.pointerType === "mouse" && follow(event, track) }, ...bars, cursor.node);
    cursors.push(cursor);
    return SSM.element("div", { class: "row" }, SSM.element("span", { class: "name" }, name), track);
  };
  const follow = (event, track) => {
    const box = track.getBoundingClientRect();
    player.pause();
    player.at((end * (event.clientX - box.left)) / box.width);
  };
  const cursors = [];
  const groups = new Map();
  for (const stretch of data.panels.flatMap((panel) => panel.active)) {
    groups.set(stretch.label, [...(groups.get(stretch.label) ?? []), stretch]);
  }
  const rows = [...groups].map(([label, list]) => row(label, list.map((s) => bar(label, s.start, s.end, "bar", data.colours[s.joint])),
    list.map((s) => `${s.start.toFixed(3)} to ${s.end.toFixed(3)} s`).join(", ")));
  const none = groups.size ? [] : [SSM.element("p", {}, "No limit comes within half a percent.")];
  container.replaceChildren(SSM.element("h2", {}, "Which limit is active when"), SSM.element("div", { class: "timeline" }, ...rows), ...none);
  player.listen((index) => {
    for (const cursor of cursors) cursor.at(player.times[index] / end);
  });
};

// joint values of two motions at the shown instant
SSM.compareNow = (container, data, channels, names) => {
  const degrees = 180 / Math.PI;
  const cells = [];
  const rows = data.joints.map((joint, i) => {
    const [unit, scale] = joint.kind === "revolute" ? ["°", degrees] : ["mm", 1000];
    const row = SSM.element("tr", {}, SSM.element("th", { scope: "row" }, `${joint.name}, ${unit}`));
    for (const [channel, factor, digits] of [[`q${i}`, scale, 3], [`qd${i}`, scale, 2], [`tau${i}`, 1000, 3]]) {
      for (const side of [0, 1]) {
        const node = SSM.element("td", { class: "number", "data-channel": `${names[side]} ${channel}` });
        if (channel in channels[side]) cells.push({ node, values: channels[side][channel], factor, digits });
        else node.textContent = "–";
        row.append(node);
      }
    }
    return row;
  });
  const heads = ["joint", ...[["q", ""], ["q̇", " /s"], ["mN·m", ""]].flatMap(([value, per]) => names.map((name) => `${value} ${name}${per}`))]
    .map((text) => SSM.element("th", { scope: "col" }, text));
  const table = SSM.element("table", {}, SSM.element("thead", {}, SSM.element("tr", {}, ...heads)), SSM.element("tbody", {}, ...rows));
  const key = (side, text) => SSM.element("span", { class: "key" }, SSM.swatch(data.colours[side], SSM.dashes[side]), text);
  container.replaceChildren(SSM.scrolling(table),
    SSM.element("p", {}, key(0, `${names[0]}, solid in 3D`), " ", key(1, `${names[1]}, orange and translucent in 3D`)));
  return (index) => {
    for (const { node, values, factor, digits } of cells) SSM.say(node, SSM.fixed(factor * values[index], digits));
  };
};
