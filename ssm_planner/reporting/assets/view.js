// The local view. Sliders send requests to the server, which evaluates the equations. The mechanism and the tilt band follow the sliders at
// once, and the motion is planned when they rest.
"use strict";
(() => {
  const { start, token, colours } = SSM.data();
  const degrees = 180 / Math.PI;
  const click = (name, run) => byId(name).addEventListener("click", run);
  const names = [...document.querySelectorAll(".slider > label + *")].map(({ id }) => id);
  const POSE = ["roll", "tilt", "spin", "depth"];
  // The name of a value of a motor or gear is its path in the robot file, and its unit is that of the file.
  const isPart = (name) => name.includes(".");
  const isText = (name) => byId(name).type !== "range";
  const scale = (name) => ({ depth: 1000, payload: 1000 })[name] ?? (isPart(name) ? 1 : degrees);
  const state = { branch: null, from: POSE.map((name) => start.values[name]), steps: [], own: true, relaxed: false, pinned: null,
    robot: true, job: null, planned: null, solutions: null, written: null };

  const postRequest = async (path, request) => {
    const answer = await fetch(path, { method: "POST", body: JSON.stringify({ of: location.pathname, ...request }),
      headers: { "Content-Type": "application/json", "X-Token": token } });
    const body = await answer.json();
    if (!answer.ok) throw Object.assign(new Error(body.error), { key: body.key, reason: body.reason });
    return body;
  };

  // Exact SI value of each field. The displayed value is rounded.
  const exact = {};
  const box = (name) => byId(`${name}-number`) ?? byId(name);
  const exactText = (name) => (isText(name) ? exact[name] : String(Number((exact[name] * scale(name)).toFixed(6))));
  const setField = (name, si) => {
    showFault(name, "");
    exact[name] = si;
    if (!isText(name)) byId(name).value = si * scale(name);
    box(name).value = exactText(name);
  };
  // Show a message beside the field to which it applies.
  const showFault = (name, text) => {
    byId(`${name}-error`).textContent = text;
    byId(`${name}-number`)?.setAttribute("aria-invalid", String(Boolean(text)));
  };
  const reportError = (error) => {
    const key = (error.key ?? "").replace(/robot\.|_static|\.value$/g, "");
    const part = key.split(".").pop();
    const number = key.match(/motion\[(\d+)\]/);
    let name = { tilt_range: "high", start: "from", tip_payload: "payload" }[key] ?? part;
    let text = error.reason ?? error.message;
    if (byId(`${key}-error`)) name = key;
    else if (number && state.steps.length) [name, text] = ["motion", `entry ${Number(number[1]) + 1}, ${part}: ${text}`];
    else if (key.includes("start")) [name, text] = ["from", `${part}: ${text}`];
    if (byId(`${name}-error`)) showFault(name, text);
    else byId("verdict").textContent = error.message;
  };
  const pose = () => POSE.map((name) => exact[name]);
  const describeCoordinates = (labels, values) => values.map((si, i) => `${labels[i]} ${fixed(si * scale(POSE[i]), 1)} ${i === 3 ? "mm" : "°"}`).join(", ");
  const describePose = (place) => describeCoordinates(POSE, place);

  const scene = new SSM.Scene(byId("scene"), []);

  const showWorkspace = (answer) => {
    state.robot = answer.own;
    scene.clear();
    scene.add({ scene: answer.scene, colours, begin: state.begin });
    const [low, high] = answer.tilt_range.map((x) => fixed(x * degrees, 3));
    const spare = fixed(Math.abs(answer.margin) * degrees, 2);
    byId("reach").textContent = `The mechanism reaches ${low}° to ${high}°: ` +
      (answer.reached ? `the required range, with ${spare}° to spare.` : `the required range is larger by ${spare}°.`);
    byId("reach").className = answer.reached ? "good" : "bad";
    updateControls();
  };

  const draw = () => {
    const chosen = state.solutions?.branches.find(({ branch }) => branch === state.branch);
    if (chosen) scene.pose(0, chosen.joints);
  };

  const showBranches = (answer) => {
    state.solutions = answer;
    if (!answer.branches.some(({ branch }) => branch === state.branch)) {
      state.branch = (answer.branches.find(({ in_limits }) => in_limits) ?? answer.branches[0]).branch;
    }
    byId("branches").replaceChildren(...answer.branches.map(({ joints, branch, in_limits }) => element("option", { value: branch, selected: branch === state.branch },
      describeCoordinates(start.joints, joints), in_limits ? "" : " — outside the joint limits")));
    byId("reached").textContent = answer.reachable ? "The pose is reachable." :
      `Outside the workspace: the nearest pose is drawn, its tool axis ${fixed(answer.error * degrees, 2)}° away.`;
    byId("reached").className = answer.reachable ? "good" : "bad";
    draw();
  };

  // Return a function that runs `run` at most once at a time. Calls during a run cause one more run with the newest values.
  // A call marks `outputs` as outdated, until `run` shows its answer there.
  const runLatest = (run, ...outputs) => {
    let [running, again] = [false, false];
    const go = async () => {
      outputs.forEach((name) => byId(name).classList.add("old"));
      if (running) { again = true; return; }
      running = true;
      try {
        await run();
      } catch (error) {
        reportError(error);
      }
      running = false;
      if (again) { again = false; go(); }
    };
    return go;
  };
  const tiltRange = () => [exact.low, exact.high];
  const angles = () => ({ alpha: exact.alpha, beta: exact.beta });
  const shownPose = () => ({ ...angles(), pose: pose() });
  // An answer is ignored if a newer request has been sent. It is outdated if the settings have changed.
  let newest;
  const askJoints = async () => {
    const asked = newest = shownPose();
    const answer = await postRequest("/ik", asked);
    return () => {
      if (asked !== newest) return;
      showBranches(answer);
      byId("reached").classList.toggle("old", JSON.stringify(asked) !== JSON.stringify(shownPose()));
    };
  };
  const updatePose = runLatest(async () => (await askJoints())(), "reached");
  const updateAll = runLatest(async () => {
    const [band, showJoints, begin] = await Promise.all([postRequest("/workspace", { ...angles(), tilt_range: tiltRange() }),
      askJoints(), postRequest("/ik", { ...angles(), pose: state.from })]);
    const nearest = begin.branches.find(({ branch, in_limits }) => in_limits && branch === state.branch) ?? begin.branches.find(({ in_limits }) => in_limits);
    state.begin = begin.reachable ? (nearest ?? begin.branches[0]).joints : null;
    showWorkspace(band);
    showJoints();
    SSM.ready ??= performance.now();
  }, "reach", "reached");

  // A chosen motor or gear determines its figures, so their fields are hidden.
  const isReplaced = (name) => {
    const [, owner] = name.match(/(.*\.)(?:motor|geometry)\./) ?? [];
    return ["motor", "worm", "screw"].some((part) => exact[owner + part]);
  };
  // True if a field shows a text that was refused or is still typed.
  const isPending = (name) => !isReplaced(name) && box(name).value !== exactText(name);
  const changes = () => names.filter((name) => isPart(name) && !isReplaced(name) && exact[name] !== start.values[name]).map((name) => [name, exact[name]]);
  // The settings that determine a planning run. A shown result is outdated if they have changed.
  const planSettings = () => ({ of: location.pathname, ...angles(), design: Object.fromEntries(changes()), payload: exact.payload, relaxed: state.relaxed,
    ...(state.own ? { own: true } : { start: state.from, motion: state.steps.length ? state.steps : [{ pose: pose() }], tilt_range: tiltRange() }) });
  // The text shows the problem without its relaxation.
  const fileSettings = () => ({ ...planSettings(), relaxed: false });
  const currentRequest = () => JSON.stringify({ ...planSettings(), pinned: state.pinned });
  const reportIfCurrent = (asked) => (error) => asked === currentRequest() && reportError(error);
  const planningObstacle = () => (!start.can_plan ? "Planning needs a robot with drives: ssm-planner view PROBLEM."
    : names.some(isPending) ? "A field shows a value that is not used yet. Correct it, or press Enter."
    : state.own || state.steps.length || String(pose()) !== String(state.from) ? ""
      : "The pose is the start of the motion. Move a slider of the pose, or plan the motion of the problem file.");
  const updateControls = () => {
    const pending = names.some(isPending);
    const stale = state.planned !== null && (pending || state.planned !== currentRequest());
    byId("controls").classList.toggle("pending", pending);
    byId("rewrite").hidden = state.written === null || (!pending && state.written === JSON.stringify(fileSettings()));
    byId("stale").style.visibility = stale ? "visible" : "hidden";
    byId("desk").classList.toggle("old", stale);
    const assumed = [!state.robot && "The links keep their masses and shapes; their frames follow α and β.",
      changes().length && "Drives keep their inertia, and static friction its ratio to μ; a chosen motor brings its own rotor.",
      exact.payload && "The payload is a point mass at the tip."];
    byId("why").textContent = planningObstacle() || assumed.filter(Boolean).join(" ");
    byId("plan").disabled = byId("pin").disabled = byId("save").disabled = Boolean(planningObstacle());
    names.filter(isPart).forEach((name) => { byId(name).parentNode.hidden = isReplaced(name); });
    byId("pin").textContent = state.pinned ? "Unpin A" : "Pin this motion as A";
    byId("cancel").disabled = !state.job;
    byId("from").textContent = state.own ? "The motion of the problem file" : `From: ${describePose(state.from)}`;
    byId("to").textContent = `${state.own || state.steps.length ? "Shown, not part of the motion" : "To"}: ${describePose(pose())}`;
    byId("steps").replaceChildren(...(state.own ? [] : state.steps).map((step) => {
      const text = step.pose ? describePose(step.pose) : `dwell ${short(step.dwell)} s`;
      const away = element("button", { type: "button", "aria-label": `Remove ${text}`, onclick: () => applySettings({ steps: state.steps.filter((other) => other !== step) }) }, "×");
      return element("li", {}, text, " ", away);
    }));
  };
  const applySettings = (more = {}) => {
    Object.assign(state, { relaxed: false }, more);
    updateControls();
  };

  // Use the value of a slider or of a typed number. A slider at one end of the tilt range pushes the other end.
  // A typed value is used unchanged, or refused beside the field.
  const bounds = (name) => [Number(byId(name).min), Number(byId(name).max)];
  const inside = (name, shown) => shown >= bounds(name)[0] - 1e-9 && shown <= bounds(name)[1] + 1e-9;
  const changed = (name, shown, typed) => {
    const unit = byId(`${name}-number`).nextElementSibling.textContent;
    if (!Number.isFinite(shown)) return showFault(name, "not a number");
    if (!inside(name, shown)) return showFault(name, `${short(shown)} ${unit} is out of range: ${bounds(name).map(short).join(" to ")} ${unit}`);
    const si = shown / scale(name);
    const step = 0.1 / degrees;
    const crossed = (name === "low" && si >= exact.high) || (name === "high" && si <= exact.low);
    if (crossed && typed) return showFault(name, name === "low" ? "must be below the upper end" : "must be above the lower end");
    setField(name, si);
    if (crossed) setField(name === "low" ? "high" : "low", name === "low" ? si + step : si - step);
    applySettings(POSE.includes(name) ? { own: false } : {});
    if (POSE.includes(name)) updatePose();
    else if (!isPart(name)) updateAll();
  };
  for (const name of names) {
    if (isText(name)) byId(name).addEventListener("change", (event) => { setField(name, event.target.value); applySettings(); });
    else {
      byId(name).addEventListener("input", (event) => changed(name, event.target.valueAsNumber, false));
      byId(`${name}-number`).addEventListener("change", (event) => changed(name, event.target.valueAsNumber, true));
    }
  }

  SSM.height = () => 130;
  const player = new SSM.Player(byId("player"), [0, 1], []);
  const plots = new SSM.Plots(byId("plots"), player, colours, [], /^$/);
  const showCurves = (desk) => {
    for (const { u } of plots.all) u.destroy();
    plots.seen.disconnect();
    plots.sizes.disconnect();
    Object.assign(plots, { all: [], section: null });
    byId("plots").replaceChildren();
    byId("player").hidden = !desk;
    if (!desk) return;
    const channels = desk.channels.map(SSM.channels);
    const last = channels.at(-1);
    player.times = last.t;
    player.range.max = last.t.length - 1;
    player.listeners.length = 1;
    player.listeners.push((index) => scene.pose(0, SSM.joints(last, index)));
    SSM.overlay(plots, desk, channels, desk.names);
    player.set(state.own ? player.index : Infinity);
  };
  // Create a slider over `changes`, which contains fractions of the relaxation and their descriptions.
  const slider = (changes) => {
    const at = Math.max(0, changes.findIndex(([share]) => share === state.relaxed));
    const words = element("label", { for: "change" }, changes[at][1]);
    const range = element("input", { type: "range", id: "change", min: 0, max: changes.length - 1, value: at,
      oninput: () => { words.textContent = changes[range.value][1]; }, onchange: () => applySettings({ relaxed: changes[range.value][0] }) });
    return [range, words];
  };
  const show = ({ message, relaxation, changes, desk, plan }) => {
    const job = state.job;
    const link = (kind, text, more) => element("a", { href: `/${kind}/${job}`, ...more }, text);
    const links = relaxation ? [element("button", { type: "button", id: "relax", onclick: () => applySettings({ relaxed: 1 }) }, `Plan with ${changes.length ? "this change" : relaxation}`)]
      : plan ? [link("report", "Report in a new tab", { target: "_blank", rel: "noopener" }), link("plan", "plan.json", { download: "plan.json" })] : [];
    const row = (cells) => element("tr", {}, ...cells.map((text, i) => element(i ? "td" : "th", { scope: i ? null : "row" }, text)));
    const head = desk?.names.length > 1 ? [["", ...desk.names]] : [];
    byId("outcome").replaceChildren(element("p", { class: "outcome", role: "status" }, message),
      element("table", {}, ...[...head, ...(desk?.rows ?? [])].map(row)), element("p", { class: "buttons" }, ...(changes?.length ? slider(changes) : []), ...links));
    showCurves(desk);
  };
  // Plan whenever the settings differ from those of the shown result. The address contains the settings, so it can be reloaded and bookmarked.
  const planIfChanged = runLatest(async () => {
    const { from, steps, own, pinned } = state;
    history.replaceState(null, "", `#${encodeURIComponent(JSON.stringify({ ...exact, from, steps, own, pinned }))}`);
    const asked = currentRequest();
    if (planningObstacle() || asked === state.planned) return;
    let answer = {};
    try {
      [...names, "from", "motion", "dwell"].forEach((name) => showFault(name, ""));
      byId("verdict").textContent = "";
      state.job = (await postRequest("/plan", JSON.parse(asked))).job;
      while (!answer.done) {
        answer = await postRequest("/progress", { job: state.job });
        byId("step").textContent = answer.done ? "" : answer.steps.at(-1) ?? "";
        updateControls();
        if (!answer.done) await new Promise((resolve) => setTimeout(resolve, 40));
      }
    } catch (error) {
      answer = { message: "not planned" };
      reportIfCurrent(asked)(error);
    }
    if (asked === currentRequest()) {
      show(answer);
      state.planned = asked;
    }
    state.job = null;
    updateControls();
  });
  for (const [kind, run] of [["input", updateControls], ["change", planIfChanged], ["click", planIfChanged]]) document.querySelector("main").addEventListener(kind, run);
  byId("branches").addEventListener("change", (event) => { state.branch = Number(event.target.value); draw(); });
  click("plan", () => { state.planned = ""; });
  click("whole", () => applySettings({ own: true }));
  click("pin", () => applySettings({ pinned: state.pinned ? null : planSettings(), relaxed: state.relaxed }));
  click("cancel", () => postRequest("/cancel", { job: state.job }).catch(reportError));
  // Call a function with settings as YAML.
  const asYaml = (settings, use) => postRequest("/yaml", settings).then(({ text }) => use(text, settings)).catch(reportIfCurrent(currentRequest()));
  const writeText = () => asYaml(fileSettings(), (text, settings) => {
    byId("text").value = text;
    state.written = JSON.stringify(settings);
    updateControls();
  });
  click("save", () => asYaml(planSettings(), (text) => SSM.download("problem.yaml", text, "application/yaml")));
  byId("source").addEventListener("toggle", ({ target }) => target.open && writeText());
  click("write", writeText);
  click("apply", () => postRequest("/edit", { text: byId("text").value })
    .then(({ page }) => location.assign(`${page}#${encodeURIComponent(JSON.stringify({ pinned: state.pinned }))}`))
    .catch(({ message }) => showFault("text", message)));
  click("here", () => { applySettings({ from: pose(), own: false }); updateAll(); });
  click("waypoint", () => applySettings({ steps: [...state.steps, { pose: pose() }], own: false }));
  click("dwell", () => {
    const time = byId("dwell-number").valueAsNumber;
    if (!(time >= 0.001 && time <= 3600)) return showFault("dwell", "a dwell must last 0.001 s to 3600 s");
    showFault("dwell", "");
    applySettings({ steps: [...state.steps, { dwell: time }], own: false });
  });
  const setAllFields = (values) => {
    for (const [name, si] of Object.entries(values)) setField(name, si);
    applySettings();
    updateAll();
  };
  click("own", () => { state.own = true; setAllFields(start.values); });
  click("suggest", () => postRequest("/suggest", { tilt_range: tiltRange() }).then(({ alpha, beta }) => {
    setAllFields({ alpha, beta });
    planIfChanged();
  }).catch(reportError));

  // Restore the settings from the address, as far as the fields accept them.
  const restoreSettings = () => {
    let stored = {};
    try { stored = JSON.parse(decodeURIComponent(location.hash.slice(1))) ?? {}; } catch { return; }
    const fits = (name, si) => (isText(name) ? typeof si === "string" : Number.isFinite(si) && inside(name, si * scale(name)));
    const isPose = (each) => Array.isArray(each) && each.length === 4 && each.every((si, i) => fits(POSE[i], si));
    for (const name of names) if (fits(name, stored[name])) setField(name, stored[name]);
    if (isPose(stored.from)) state.from = stored.from;
    if (Array.isArray(stored.steps)) state.steps = stored.steps.filter((each) => each && (isPose(each.pose) || Number.isFinite(each.dwell)));
    state.own = stored.own !== false;
    state.pinned = stored.pinned ?? null;
  };

  ["min", "max"].forEach((end, i) => { byId("depth")[end] = (1000 * start.depth_range[i]).toFixed(3); });
  for (const name of names) setField(name, start.values[name]);
  restoreSettings();
  updateControls();
  updateAll();
  planIfChanged();
  SSM.scene = scene;
})();
