// The local view: sliders ask the server, which holds the equations; the mechanism and its band follow at once.
"use strict";
(() => {
  const { start, token, colours } = SSM.data();
  const degrees = 180 / Math.PI;
  const find = (name) => document.getElementById(name);
  const scales = { depth: 1000 };
  const state = { sign: null, from: [...start.pose], own: true, job: null, found: null, steps: [] };

  const ask = async (path, request) => {
    const answer = await fetch(path, { method: "POST", body: JSON.stringify(request),
      headers: { "Content-Type": "application/json", "X-Token": token } });
    const body = await answer.json();
    if (!answer.ok) throw Object.assign(new Error(body.error), { key: body.key, reason: body.reason });
    return body;
  };

  // SI value of a field; exact where nobody has moved it
  const exact = {};
  const value = (name) => exact[name];
  const put = (name, si) => {
    exact[name] = si;
    const shown = si * (scales[name] ?? degrees);
    find(name).value = shown;
    find(`${name}-number`).value = Number(shown.toFixed(6));
    fault(name, "");
  };
  // a message beside the field that it means
  const fault = (name, text) => {
    find(`${name}-error`).textContent = text;
    find(`${name}-number`)?.setAttribute("aria-invalid", String(Boolean(text)));
  };
  const blame = (error) => {
    const key = error.key ?? "";
    const part = key.split(".").pop();
    const number = key.match(/motion\[(\d+)\]/);
    let name = { tilt_range: "high", start: "from", target: "motion" }[key] ?? part;
    let text = error.reason ?? error.message;
    if (number && state.steps.length) [name, text] = ["motion", `entry ${Number(number[1]) + 1}, ${part}: ${text}`];
    else if (key.includes("start")) [name, text] = ["from", `${part}: ${text}`];
    if (find(`${name}-error`)) fault(name, text);
    else find("verdict").textContent = error.message;
  };
  const names = ["alpha", "beta", "low", "high", "roll", "tilt", "spin", "depth"];
  const pose = () => ["roll", "tilt", "spin", "depth"].map(value);
  const words = ([roll, tilt, spin, depth]) => `roll ${SSM.fixed(roll * degrees, 1)}°, tilt ${SSM.fixed(tilt * degrees, 1)}°, ` +
    `spin ${SSM.fixed(spin * degrees, 1)}°, depth ${SSM.fixed(depth * 1000, 1)} mm`;

  const scene = new SSM.Scene(find("scene"), []);

  const showWorkspace = (answer) => {
    state.own = answer.own;
    scene.clear();
    scene.add({ scene: answer.scene, colours, begin: state.begin });
    const [low, high] = answer.tilt_range.map((x) => SSM.fixed(x * degrees, 3));
    const spare = SSM.fixed(Math.abs(answer.margin) * degrees, 2);
    find("reach").textContent = `The mechanism reaches ${low}° to ${high}°: ` +
      (answer.reached ? `the required range, with ${spare}° to spare.` : `the required range is larger by ${spare}°.`);
    find("reach").className = answer.reached ? "good" : "bad";
    whyNot();
  };

  const draw = () => {
    const chosen = state.found?.branches.find(({ branch }) => branch === state.sign);
    if (chosen) scene.pose(0, chosen.joints);
  };

  const showBranches = (answer) => {
    state.found = answer;
    if (!answer.branches.some(({ branch }) => branch === state.sign)) {
      state.sign = (answer.branches.find(({ in_limits: inside }) => inside) ?? answer.branches[0]).branch;
    }
    const choice = ({ joints, branch, in_limits: inside }) => {
      const text = start.joints.map((name, i) => `${name} ${SSM.fixed(joints[i] * (i === 3 ? 1000 : degrees), 3)} ${i === 3 ? "mm" : "°"}`);
      const radio = SSM.element("input", { type: "radio", name: "branch", value: branch, checked: branch === state.sign,
        onchange: () => { state.sign = branch; draw(); } });
      return SSM.element("label", { class: "branch" }, radio, SSM.element("span", {}, SSM.element("strong", {}, `branch ${branch > 0 ? "+1" : "−1"} `),
        text.join(", "), inside ? "" : " — outside the joint limits"));
    };
    const focused = document.activeElement?.name === "branch";
    find("branches").replaceChildren(SSM.element("fieldset", {}, SSM.element("legend", {}, "Inverse kinematics"), ...answer.branches.map(choice)));
    if (focused) find("branches").querySelector(":checked")?.focus();
    find("reached").textContent = answer.reachable ? "The pose is reachable." :
      `Outside the workspace: the nearest pose is drawn, its tool axis ${SSM.fixed(answer.error * degrees, 2)}° away.`;
    find("reached").className = answer.reachable ? "good" : "bad";
    draw();
  };

  // one request of a kind under way, the newest values next
  const follower = (run) => {
    let [running, again] = [false, false];
    const go = async () => {
      if (running) { again = true; return; }
      running = true;
      try {
        await run();
        find("verdict").textContent = "";
      } catch (error) {
        blame(error);
      }
      running = false;
      if (again) { again = false; go(); }
    };
    return go;
  };
  const range = () => [value("low"), value("high")];
  const angles = () => ({ alpha: value("alpha"), beta: value("beta") });
  // an answer is shown unless a newer one has been asked for
  let newest = 0;
  const askJoints = async () => {
    const number = ++newest;
    const answer = await ask("/ik", { ...angles(), pose: pose() });
    return () => number === newest && showBranches(answer);
  };
  const updatePose = follower(async () => (await askJoints())());
  const updateAll = follower(async () => {
    const [band, showJoints, begin] = await Promise.all([ask("/workspace", { ...angles(), tilt_range: range() }),
      askJoints(), ask("/ik", { ...angles(), pose: state.from })]);
    const nearest = begin.branches.find(({ branch, in_limits: inside }) => inside && branch === state.sign) ?? begin.branches.find(({ in_limits: inside }) => inside);
    state.begin = begin.reachable ? (nearest ?? begin.branches[0]).joints : null;
    showWorkspace(band);
    showJoints();
    SSM.ready ??= performance.now();
  });

  // a verdict holds for the settings that it judged
  const judged = () => JSON.stringify(wanted());
  const whyNot = () => {
    const stale = Boolean(state.judged) && state.judged !== judged();
    find("stale").hidden = !stale;
    find("outcome").classList.toggle("old", stale);
    find("result").hidden = stale;
    const reason = !start.can_plan ? "Planning needs a robot with drives: ssm-planner view PROBLEM."
      : !state.steps.length && String(pose()) === String(state.from) ? "The pose is the start of the motion. Move a slider of the pose, or plan the motion of the problem file." : "";
    find("why").textContent = reason || (state.own ? "" : "The links keep their masses and shapes; their frames follow α and β.");
    find("plan").disabled = Boolean(reason) || Boolean(state.job);
    find("save").disabled = Boolean(reason);
    find("whole").disabled = !start.can_plan || Boolean(state.job);
    find("cancel").disabled = !state.job;
  };
  const places = () => {
    find("from").textContent = `From: ${words(state.from)}`;
    find("to").textContent = `${state.steps.length ? "Shown, not part of the motion" : "To"}: ${words(pose())}`;
    find("steps").replaceChildren(...state.steps.map((step, i) => {
      const text = step.pose ? words(step.pose) : `dwell ${SSM.short(step.dwell)} s`;
      const away = SSM.element("button", { type: "button", "aria-label": `Remove ${text}`, onclick: () => { state.steps.splice(i, 1); kept(); } }, "×");
      return SSM.element("li", {}, text, " ", away);
    }));
  };
  // all that is set stands in the address: it can be reloaded, sent and bookmarked
  const kept = () => {
    places();
    whyNot();
    const all = Object.fromEntries(names.map((name) => [name, value(name)]));
    const text = JSON.stringify({ ...all, from: state.from, steps: state.steps, job: state.job ?? state.last, judged: state.judged });
    history.replaceState(null, "", `#${encodeURIComponent(text)}`);
  };

  // from a slider: one end of the range pushes the other. What is typed is used as it is, or refused beside the field.
  const bounds = (name) => [Number(find(name).min), Number(find(name).max)];
  const changed = (name, shown, typed) => {
    const [low, high] = bounds(name);
    const unit = name === "depth" ? " mm" : "°";
    if (!Number.isFinite(shown)) return fault(name, "not a number");
    if (shown < low - 1e-9 || shown > high + 1e-9) return fault(name, `${SSM.short(shown)}${unit} is out of range: ${SSM.short(low)}${unit} to ${SSM.short(high)}${unit}`);
    const si = shown / (scales[name] ?? degrees);
    const step = 0.1 / degrees;
    const crossed = (name === "low" && si >= value("high")) || (name === "high" && si <= value("low"));
    if (crossed && (typed || Math.abs(shown) >= 180)) {
      return fault(name, name === "low" ? "must be below the upper end" : "must be above the lower end");
    }
    put(name, si);
    if (crossed) put(name === "low" ? "high" : "low", name === "low" ? si + step : si - step);
    kept();
    if (["roll", "tilt", "spin", "depth"].includes(name)) updatePose();
    else updateAll();
    return null;
  };
  for (const name of names) {
    find(name).addEventListener("input", (event) => changed(name, event.target.valueAsNumber, false));
    find(`${name}-number`).addEventListener("change", (event) => changed(name, event.target.valueAsNumber, true));
  }

  const wanted = () => ({ ...angles(), start: state.from, motion: state.steps.length ? state.steps : [{ pose: pose() }], tilt_range: range() });
  const link = (href, text, more = {}) => SSM.element("p", {}, SSM.element("a", { href, ...more }, text));
  const follow = async (begin, inputs = judged()) => {
    const steps = SSM.element("ol", { class: "steps", "aria-live": "polite" });
    const message = SSM.element("p", { role: "status", class: "outcome" }, "Planning …");
    const bar = SSM.element("progress", { "aria-label": "Planning" });
    find("outcome").replaceChildren(message, bar, steps);
    find("result").replaceChildren();
    ["from", "motion", "dwell"].forEach((name) => fault(name, ""));
    try {
      state.judged = null;
      state.job = await begin();
      state.judged = inputs;
      state.last = state.job;
      kept();
      whyNot();
      for (;;) {
        const answer = await ask("/progress", { job: state.job });
        while (steps.childElementCount < answer.steps.length) steps.append(SSM.element("li", {}, answer.steps[steps.childElementCount]));
        steps.scrollTop = steps.scrollHeight;
        if (answer.done) { finished(answer, message); break; }
        await new Promise((resolve) => setTimeout(resolve, 150));
      }
    } catch (error) {
      message.textContent = error.key ? "not planned" : error.message;
      blame(error);
    }
    bar.remove();
    state.job = null;
    whyNot();
  };
  const finished = (answer, message) => {
    message.textContent = answer.message;
    if (answer.relaxation) {
      const { last } = state;
      message.after(SSM.element("button", { type: "button", id: "relax", onclick: () => follow(async () => (await ask("/plan", { relaxed: last })).job) },
        `Plan with ${answer.relaxation}`));
    }
    if (!answer.report) return;
    message.after(link(answer.report, "Open the report in a new tab", { target: "_blank", rel: "noopener" }), link("#result", "Go to the report below"),
      link(answer.plan, "Download plan.json", { download: "plan.json" }));
    find("outcome").querySelector('[href="#result"]').addEventListener("click", (event) => { event.preventDefault(); find("result").scrollIntoView(); });
    find("result").append(SSM.element("h2", {}, "Plan"), SSM.element("iframe", { src: answer.report, title: "Report of the plan" }));
  };
  find("plan").addEventListener("click", () => follow(async () => (await ask("/plan", wanted())).job));
  find("whole").addEventListener("click", () => follow(async () => (await ask("/plan", { own: true })).job));
  find("cancel").addEventListener("click", () => ask("/cancel", { job: state.job }).catch(blame));
  find("save").addEventListener("click", async () => {
    try {
      const { text } = await ask("/yaml", wanted());
      SSM.download("problem.yaml", text, "application/yaml");
    } catch (error) { blame(error); }
  });
  find("here").addEventListener("click", () => { state.from = pose(); kept(); updateAll(); });
  find("waypoint").addEventListener("click", () => { state.steps.push({ pose: pose() }); kept(); });
  find("dwell").addEventListener("click", () => {
    const time = find("dwell-number").valueAsNumber;
    if (!(time >= 0.001 && time <= 3600)) return fault("dwell", "a dwell must last 0.001 s to 3600 s");
    fault("dwell", "");
    state.steps.push({ dwell: time });
    return kept();
  });
  find("own").addEventListener("click", () => { put("alpha", start.alpha); put("beta", start.beta); kept(); updateAll(); });
  find("suggest").addEventListener("click", async () => {
    try {
      const found = await ask("/suggest", { tilt_range: range() });
      put("alpha", found.alpha);
      put("beta", found.beta);
      kept();
      updateAll();
    } catch (error) { blame(error); }
  });

  // what the address holds, as far as it is what the fields take
  const recall = () => {
    let held = {};
    try { held = JSON.parse(decodeURIComponent(location.hash.slice(1))) ?? {}; } catch { return; }
    const inside = (name, si) => Number.isFinite(si) && si * (scales[name] ?? degrees) >= bounds(name)[0] - 1e-9 && si * (scales[name] ?? degrees) <= bounds(name)[1] + 1e-9;
    const isPose = (each) => Array.isArray(each) && each.length === 4 && each.every((si, i) => inside(names[4 + i], si));
    for (const name of names) if (inside(name, held[name])) put(name, held[name]);
    if (value("low") >= value("high")) start.tilt_range.forEach((si, i) => put(["low", "high"][i], si));
    if (isPose(held.from)) state.from = held.from;
    if (Array.isArray(held.steps)) state.steps = held.steps.filter((each) => each && (isPose(each.pose) || Number.isFinite(each.dwell)));
    if (typeof held.job === "string") {
      ask("/progress", { job: held.job }).then(() => follow(async () => held.job, held.judged)).catch(() => {});
    }
  };

  for (const end of ["min", "max"]) {
    find("depth")[end] = (1000 * start.depth_range[end === "min" ? 0 : 1]).toFixed(3);
  }
  [start.alpha, start.beta, ...start.tilt_range, ...start.pose].forEach((si, i) => put(names[i], si));
  recall();
  places();
  whyNot();
  updateAll();
  SSM.scene = scene;
})();
