// The local view: sliders ask the server, which holds the equations; the mechanism and its band follow at once.
"use strict";
(() => {
  const { start, token, colours } = SSM.data();
  const degrees = 180 / Math.PI;
  const find = (name) => document.getElementById(name);
  const scales = { depth: 1000 };
  const state = { sign: null, from: [...start.pose], own: true, busy: false, found: null };

  const ask = async (path, request) => {
    const answer = await fetch(path, { method: "POST", body: JSON.stringify(request),
      headers: { "Content-Type": "application/json", "X-Token": token } });
    const body = await answer.json();
    if (!answer.ok) throw new Error(body.error);
    return body;
  };

  // SI value of a slider; exact where nobody has moved it
  const exact = {};
  const value = (name) => exact[name];
  const put = (name, si) => {
    exact[name] = si;
    const shown = si * (scales[name] ?? degrees);
    find(name).value = shown;
    find(`${name}-number`).value = Number(shown.toFixed(3));
  };
  const names = ["alpha", "beta", "low", "high", "roll", "tilt", "spin", "depth"];
  const pose = () => ["roll", "tilt", "spin", "depth"].map(value);
  const words = ([roll, tilt, spin, depth]) => `roll ${SSM.fixed(roll * degrees, 1)}°, tilt ${SSM.fixed(tilt * degrees, 1)}°, ` +
    `spin ${SSM.fixed(spin * degrees, 1)}°, depth ${SSM.fixed(depth * 1000, 1)} mm`;

  const scene = new SSM.Scene(find("scene"), []);

  const showWorkspace = (answer) => {
    state.own = answer.own;
    scene.clear();
    scene.add({ scene: answer.scene, colours });
    const [low, high] = answer.tilt_range.map((x) => SSM.fixed(x * degrees, 3));
    const spare = SSM.fixed(Math.abs(answer.margin) * degrees, 2);
    find("reach").textContent = `The mechanism reaches ${low}° to ${high}°: ` +
      (answer.reached ? `the range wanted, with ${spare}° to spare.` : `not the range wanted, ${spare}° are missing.`);
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
    find("reached").textContent = answer.reachable ? "The pose is reached." :
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
        find("verdict").textContent = error.message;
      }
      running = false;
      if (again) { again = false; go(); }
    };
    return go;
  };
  const angles = () => ({ alpha: value("alpha"), beta: value("beta") });
  const updatePose = follower(async () => showBranches(await ask("/ik", { ...angles(), pose: pose() })));
  const updateAll = follower(async () => {
    const [band, joints] = await Promise.all([
      ask("/workspace", { ...angles(), tilt_range: [value("low"), value("high")] }), ask("/ik", { ...angles(), pose: pose() })]);
    showWorkspace(band);
    showBranches(joints);
    SSM.ready ??= performance.now();
  });

  const whyNot = () => {
    const reason = !start.can_plan ? "Planning needs a robot with drives: ssm-planner view PROBLEM."
      : !state.own ? "The masses of the links are known for the robot's own α and β only: go back to them to plan." : "";
    find("why").textContent = reason;
    find("plan").disabled = Boolean(reason) || state.busy;
    find("whole").disabled = !start.can_plan || state.busy;
  };
  const places = () => {
    find("from").textContent = `From: ${words(state.from)}`;
    find("to").textContent = `To: ${words(pose())}`;
  };

  const changed = (name, shown) => {
    if (!Number.isFinite(shown)) return;
    put(name, shown / (scales[name] ?? degrees));
    if (name === "low" && value("low") >= value("high")) put("high", value("low") + 0.1 / degrees);
    if (name === "high" && value("low") >= value("high")) put("low", value("high") - 0.1 / degrees);
    places();
    if (["roll", "tilt", "spin", "depth"].includes(name)) updatePose();
    else updateAll();
  };
  for (const name of names) {
    find(name).addEventListener("input", (event) => changed(name, event.target.valueAsNumber));
    find(`${name}-number`).addEventListener("change", (event) => {
      const { min, max, valueAsNumber } = event.target;
      changed(name, Math.min(Math.max(valueAsNumber, Number(min)), Number(max)));
    });
  }

  const follow = async (request) => {
    state.busy = true;
    whyNot();
    const steps = SSM.element("ol", { class: "steps", "aria-live": "polite" });
    const message = SSM.element("p", { role: "status", class: "outcome" }, "Planning …");
    find("result").replaceChildren(SSM.element("h2", {}, "Plan"), message, steps);
    try {
      const { job } = await ask("/plan", request);
      for (;;) {
        const answer = await ask("/progress", { job });
        while (steps.childElementCount < answer.steps.length) steps.append(SSM.element("li", {}, answer.steps[steps.childElementCount]));
        if (answer.done) {
          message.textContent = answer.message;
          if (answer.report) find("result").append(
            SSM.element("p", {}, SSM.element("a", { href: answer.report, target: "_blank", rel: "noopener" }, "Open the report in a tab of its own")),
            SSM.element("iframe", { src: answer.report, title: "Report of the plan" }));
          break;
        }
        await new Promise((resolve) => setTimeout(resolve, 200));
      }
    } catch (error) {
      message.textContent = error.message;
    }
    state.busy = false;
    whyNot();
  };
  find("plan").addEventListener("click", () =>
    follow({ ...angles(), start: state.from, target: pose(), tilt_range: [value("low"), value("high")] }));
  find("whole").addEventListener("click", () => follow({ own: true }));
  find("here").addEventListener("click", () => { state.from = pose(); places(); });
  find("own").addEventListener("click", () => { put("alpha", start.alpha); put("beta", start.beta); updateAll(); });

  for (const end of ["min", "max"]) {
    for (const input of [find("depth"), find("depth-number")]) input[end] = (1000 * start.depth_range[end === "min" ? 0 : 1]).toFixed(3);
  }
  put("alpha", start.alpha);
  put("beta", start.beta);
  put("low", start.tilt_range[0]);
  put("high", start.tilt_range[1]);
  ["roll", "tilt", "spin", "depth"].forEach((name, i) => put(name, start.pose[i]));
  places();
  whyNot();
  updateAll();
  SSM.scene = scene;
})();
