// Random interactions with the page of `ssm-planner view`, for fuzz_view.py, which loads this script before the scripts of the page.
// It replaces fetch: answers come after random delays, most plans are invented, and each answer carries the number of its request.
// `campaign.faults()` compares all that the page states with the settings that it shows. It reads only the document.
"use strict";
{
  // The name of a window survives a reload.
  const settings = { seed: 1, real: false, desk: DESK, ...JSON.parse(window.name || "{}") };
  // mulberry32, a small generator with a seed
  let seed = settings.seed;
  const random = () => {
    seed = (seed + 0x6d2b79f5) | 0;
    let t = Math.imul(seed ^ (seed >>> 15), 1 | seed);
    t = (t + Math.imul(t ^ (t >>> 7), 61 | t)) ^ t;
    return ((t ^ (t >>> 14)) >>> 0) / 4294967296;
  };
  const draw = (list) => list[Math.floor(random() * list.length)];
  const sleep = (time) => new Promise((resolve) => setTimeout(resolve, time));
  const get = (name) => document.getElementById(name);
  const visible = (node) => Boolean(node) && node.getClientRects().length > 0;
  const turn = 180 / Math.PI;
  const scale = (name) => ({ alpha: turn, beta: turn, low: turn, high: turn, roll: turn, tilt: turn, spin: turn, depth: 1e3, payload: 1e3 })[name] ?? 1;
  const isNear = (shown, si, factor) => Math.abs(shown - si * factor) <= 2e-6 * Math.max(1, Math.abs(si * factor));

  const requests = []; // bodies of requests, by number
  const jobs = new Map(); // number of the request by the name of the run
  const cancelled = new Set();
  const workspaces = new Map(), poses = new Map(); // answers by request
  const saved = []; // {text, differs} of every saved file
  const settingsOf = new Map(); // settings that the page showed when it sent a request for a file
  const rest = window.fetch;
  const answerWith = (body, ok = true) => ({ ok, json: async () => body });
  const invented = (number) => {
    const kind = random();
    if (kind < 0.15) {
      return { message: `#${number} no motion`, relaxation: "velocity, roll 70 deg/s", changes: [[0.5, "velocity 65 deg/s"], [1, "velocity 70 deg/s"]], desk: null, plan: null };
    }
    return { message: `#${number} planned`, relaxation: null, changes: [], desk: { ...settings.desk, rows: [["Time", `#${number}`]] }, plan: "x" };
  };
  window.fetch = async (path, options) => {
    if (!options?.body) return rest(path, options);
    const body = JSON.parse(options.body);
    const number = requests.push(body) - 1;
    if (path === "/yaml") settingsOf.set(number, shown());
    await sleep(random() < 0.2 ? 60 * random() : 3 * random());
    if (path === "/plan" && !campaign.real) {
      if (random() < 0.1) {
        const key = draw(["alpha", "beta", "payload", "motion[0].straight.to.tilt", "start.depth", "joints.roll.drive.friction.mu", "unknown"]);
        return answerWith({ error: `refused #${number}`, key, reason: `refused #${number}` }, false);
      }
      jobs.set(`invented ${number}`, number);
      return answerWith({ job: `invented ${number}` });
    }
    if (String(body.job).startsWith("invented")) {
      if (path === "/cancel") cancelled.add(body.job);
      if (cancelled.has(body.job)) return answerWith({ done: true, steps: [], message: "cancelled", relaxation: null, changes: [], desk: null, plan: null });
      return answerWith(random() < 0.5 ? { done: false, steps: ["under way"] } : { done: true, steps: [], ...invented(jobs.get(body.job)) });
    }
    const answer = await rest(path, options);
    const content = await answer.json();
    if (path === "/plan" && answer.ok) jobs.set(content.job, number);
    if (path === "/progress" && content.done) content.message = `#${jobs.get(body.job)} ${content.message}`;
    if (path === "/yaml" && answer.ok) content.text = `# request ${number}\n${content.text}`;
    if (path === "/workspace") workspaces.set(workspaceKey(body), answer.ok && content);
    if (path === "/ik") poses.set(poseKey(body), answer.ok && content);
    if (random() < 0.2) await sleep(60 * random());
    return answerWith(content, answer.ok);
  };
  const workspaceKey = ({ alpha, beta, tilt_range }) => [alpha, beta, ...tilt_range].map((si) => (si * turn).toFixed(6)).join();
  const poseKey = ({ alpha, beta, pose: [roll, tilt, spin, depth] }) =>
    [...[alpha, beta, roll, tilt, spin].map((si) => si * turn), depth * 1e3].map((shown) => shown.toFixed(6)).join();

  // The settings that the page shows.
  const fields = () => [...document.querySelectorAll(".slider > label + *")].map(({ id }) => id);
  const shownValue = (name) => {
    const typed = get(`${name}-number`);
    if (typed) return typed.value === "" ? NaN : Number(typed.value);
    return get(name).value;
  };
  const motion = () => ({
    from: get("from").textContent, to: get("to").textContent, isPinned: get("pin").textContent.startsWith("Unpin"),
    steps: [...document.querySelectorAll("#steps li")].map(({ textContent }) => textContent),
  });
  const shown = () => ({ ...motion(), ...Object.fromEntries(fields().filter((name) => visible(get(name).parentNode) || !name.includes("."))
    .map((name) => [name, shownValue(name)])) });
  const start = () => JSON.parse(get("data").textContent).start;
  const coordinates = (text) => (text.match(/−?\d+\.\d/g) ?? []).map((number) => Number(number.replace("−", "-")));
  const isPose = (text, pose) => {
    const numbers = coordinates(text);
    return pose.every((si, i) => Math.abs(numbers[i] - si * (i === 3 ? 1e3 : turn)) < 0.0501);
  };

  // The difference between a request and the settings that the page shows, or an empty text.
  const difference = (request, of = shown()) => {
    const initial = start().values;
    for (const name of ["alpha", "beta", "payload"]) if (!isNear(of[name], request[name], scale(name))) return `${name} shown ${of[name]}, judged ${scale(name) * request[name]}`;
    for (const name of Object.keys(request.design)) if (!(name in of)) return `${name} is hidden, judged ${request.design[name]}`;
    for (const [name, value] of Object.entries(of)) {
      if (!name.includes(".")) continue;
      const judged = request.design[name] ?? initial[name];
      if (typeof value === "string" ? value !== judged : !isNear(value, judged, 1)) return `${name} shown ${value}, judged ${judged}`;
    }
    const { from, to, steps } = of;
    if (request.own) return from === "The motion of the problem file" ? "" : "the motion";
    if (!from.startsWith("From: ") || !isPose(from, request.start)) return `the start: ${from}`;
    if (!isNear(of.low, request.tilt_range[0], turn) || !isNear(of.high, request.tilt_range[1], turn)) return "the tilt range";
    const isSingle = request.motion.length === 1 && request.motion[0].pose && to.startsWith("To: ");
    if (steps.length === 0 && isSingle) return ["roll", "tilt", "spin", "depth"].every((name, i) => isNear(of[name], request.motion[0].pose[i], scale(name))) ? "" : "the target";
    if (steps.length !== request.motion.length) return `${steps.length} steps shown, ${request.motion.length} judged`;
    return request.motion.every((step, i) => (step.pose ? isPose(steps[i], step.pose) : steps[i].startsWith("dwell"))) ? "" : "the steps";
  };

  const isCurrent = (name) => ["good", "bad"].includes(get(name).className) && !get("controls").classList.contains("pending");
  const isStale = () => get("stale").style.visibility !== "hidden";
  // Refusals of a button do not concern the settings.
  const errors = () => [...document.querySelectorAll("#controls .error")].filter((node) =>
    visible(node) && node.textContent && node.id !== "dwell-error" && !node.textContent.startsWith("no α and β reach"));
  const faults = () => {
    const list = [], of = shown();
    const outcome = document.querySelector(".outcome")?.textContent ?? "";
    const number = Number(outcome.match(/^#(\d+)/)?.[1] ?? NaN);
    if (!isStale() && number >= 0) {
      campaign.current += 1;
      const request = requests[number];
      const differs = difference(request);
      if (differs) list.push(`verdict: ${differs}`);
      if (Boolean(request.pinned) !== of.isPinned) list.push("verdict: pinned motion");
      const differsPinned = request.pinned && campaign.pinned && difference(request.pinned, campaign.pinned);
      if (differsPinned) list.push(`pinned motion: ${differsPinned}`);
      if (get("verdict").textContent) list.push(`message above a current verdict: ${get("verdict").textContent}`);
      // An invented plan may belong to a problem that the server refuses to write.
      const isInvented = [...jobs].some(([name, of]) => of === number && name.startsWith("invented"));
      for (const node of errors()) if (!(isInvented && node.textContent.startsWith("the frames"))) list.push(`error beside a current verdict: ${node.id.replace(/.*\./, "")}: ${node.textContent.replace(/\d+/g, "N")}`);
      for (const link of document.querySelectorAll("#outcome a")) if (jobs.get(decodeURIComponent(link.getAttribute("href").split("/").pop())) !== number) list.push("a link to another run");
      const row = document.querySelector("#outcome td")?.textContent;
      if (row?.startsWith("#") && row !== `#${number}`) list.push("the table of another run");
    }
    if (isCurrent("reach")) {
      campaign.reaches += 1;
      const answer = workspaces.get(workspaceKey({ alpha: of.alpha / turn, beta: of.beta / turn, tilt_range: [of.low / turn, of.high / turn] }));
      const numbers = get("reach").textContent.replaceAll("−", "-").match(/-?\d+\.\d+/g).map(Number);
      if (!answer) list.push("tilt range: judged for other angles");
      else if (answer.tilt_range.some((si, i) => Math.abs(si * turn - numbers[i]) > 6e-4)) list.push("tilt range: numbers of other angles");
      else if (answer.reached !== (get("reach").className === "good")) list.push("tilt range: verdict of other angles");
    }
    if (isCurrent("reached")) {
      const answer = poses.get([of.alpha, of.beta, of.roll, of.tilt, of.spin, of.depth].map((value) => value.toFixed(6)).join());
      if (!answer) list.push("pose: judged for other settings");
      else if (answer.reachable !== (get("reached").className === "good")) list.push("pose: verdict of other settings");
    }
    const text = get("text"), file = Number(text.value.match(/^# request (\d+)/)?.[1] ?? NaN);
    if (get("source").open && file >= 0 && !campaign.edited && !visible(get("rewrite"))) {
      const differs = difference(requests[file], of);
      if (differs) list.push(`text: ${differs}`);
    }
    return list;
  };

  // One interaction, with the events that a browser sends. It returns its name.
  const tell = (node, kind) => node.dispatchEvent(new Event(kind, { bubbles: true }));
  const history = [];
  const slide = (node, value, isReleased = true) => {
    history.push([node.id, node.value]);
    node.value = value;
    tell(node, "input");
    if (isReleased) tell(node, "change");
  };
  const typed = new Set(); // fields whose text is not yet entered
  const type = (node) => {
    tell(node, "input");
    if (random() < 0.2) typed.add(node);
    else { typed.delete(node); tell(node, "change"); }
  };
  const sliders = () => [...document.querySelectorAll("#controls [type=range]")].filter(visible);
  const within = (node, share = random()) => Number(node.min) + share * (node.max - node.min);
  const actions = {
    slide: [24, () => { const node = draw(sliders()); for (let i = 0; i < 3 * random(); i++) slide(node, within(node), false); slide(node, within(node), random() < 0.9); }],
    design: [10, () => { const node = draw(sliders().filter(({ id }) => id.includes(".") || ["alpha", "beta", "payload"].includes(id))); slide(node, within(node)); }],
    type: [8, () => {
      const node = get(`${draw(sliders()).id}-number`);
      node.value = draw(["", "1e9", "-1e9", "0.13", "30", "-100", "109.778", "45.1234567", "7"]);
      type(node);
    }],
    correct: [4, () => {
      const node = draw([...document.querySelectorAll("[aria-invalid=true]")].filter(visible));
      if (!node) return;
      node.value = within(get(node.id.replace(/-number$/, "")));
      tell(node, "input");
      tell(node, "change");
    }],
    part: [8, () => { const node = draw([...document.querySelectorAll(".slider > select")]); node.value = random() < 0.5 ? "" : draw([...node.options]).value; tell(node, "change"); }],
    figure: [3, () => {
      get("figures").open = true;
      const node = draw([...document.querySelectorAll(".slider > [type=text]")].filter(visible));
      if (!node) return;
      node.value = draw(["", "", "12 V", "80 mN*m", "1e-7 kg*m^2"]);
      type(node);
    }],
    undo: [6, () => { const last = history.pop(); if (last && visible(get(last[0]))) { slide(get(last[0]), last[1]); history.pop(); } }],
    motion: [10, () => draw([...document.querySelectorAll("#whole, #here, #waypoint, #dwell, #steps button")].filter(visible)).click()],
    dwell: [1, () => { get("dwell-number").value = draw(["", "0.2", "1e9"]); tell(get("dwell-number"), "change"); }],
    own: [2, () => get("own").click()],
    suggest: [1, () => get("suggest").click()],
    plan: [3, () => get("plan").click()],
    cancel: [2, () => get("cancel").click()],
    pin: [5, () => { if (!get("pin").disabled) campaign.pinned = shown().isPinned ? null : shown(); get("pin").click(); }],
    save: [4, () => get("save").click()],
    source: [4, () => { const source = get("source"); source.open = !source.open; if (source.open) campaign.edited = false; }],
    relax: [3, () => { const node = get("change"); if (node && random() < 0.5) { node.value = draw([0, 1]); tell(node, "input"); tell(node, "change"); } else get("relax")?.click(); }],
    branch: [1, () => { const node = get("branches"); node.value = draw([...node.options])?.value; tell(node, "change"); }],
  };
  const total = Object.values(actions).reduce((sum, [weight]) => sum + weight, 0);
  const act = () => {
    let left = random() * total;
    const name = Object.keys(actions).find((key) => (left -= actions[key][0]) < 0);
    actions[name][1]();
    return name;
  };

  const counts = {};
  window.campaign = {
    real: settings.real, edited: false, pinned: null, current: 0, reaches: 0, counts, requests, jobs, saved, shown, difference, faults, isStale, errors, act, random,
    // Perform interactions and return the different faults, each with the interactions that preceded it.
    run: async (count) => {
      const list = [], recent = [];
      const judge = (when) => { for (const fault of faults()) list.push(`${fault} | ${when} ${recent.slice(-4).join(" ")}`); };
      for (let i = 0; i < count; i++) {
        const name = act();
        counts[name] = (counts[name] ?? 0) + 1;
        recent.push(name);
        judge("at once");
        await sleep(0);
        judge("after events");
        if (random() < 0.35) { await sleep(60 * random()); judge("later"); }
      }
      return list;
    },
    // Wait until nothing is under way. Return what prevents a current verdict, or an empty text.
    settle: async (seconds) => {
      document.querySelector("main").dispatchEvent(new Event("change", { bubbles: true }));
      for (const node of typed) if (visible(node)) tell(node, "change");
      typed.clear();
      for (let i = 0; i < seconds * 50; i++) {
        await sleep(20);
        if (!get("cancel").disabled) continue;
        if (!isStale() || get("plan").disabled || errors().length) return "";
      }
      return `never planned: ${document.querySelector(".outcome")?.textContent}`;
    },
  };
  document.addEventListener("DOMContentLoaded", () => {
    SSM.download = (name, text) => {
      const number = Number(text.match(/^# request (\d+)/)?.[1]);
      saved.push({ text, differs: difference(requests[number], settingsOf.get(number)) });
    };
    get("text").addEventListener("input", () => { campaign.edited = true; });
  });
}
