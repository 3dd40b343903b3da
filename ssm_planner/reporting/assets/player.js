// The time slider: play, pause, seek and speed. Everything that shows an instant registers a listener.
"use strict";
SSM.Player = class {
  constructor(container, times, phases) {
    this.times = times;
    this.phases = phases;
    this.index = 0;
    this.playing = false;
    this.listeners = [];
    const last = times.length - 1;
    this.button = element("button", { type: "button", class: "play", onclick: () => this.toggle() }, "▶ Play");
    this.range = element("input", { type: "range", min: 0, max: last, step: 1, value: 0, autocomplete: "off", "aria-label": "Time",
      oninput: () => { this.pause(); this.set(Number(this.range.value)); } });
    this.clock = element("output", { class: "clock" });
    const speeds = [0.1, 0.25, 0.5, 1, 2].map((x) => element("option", { value: x, selected: x === 1 }, `${x} ×`));
    this.speed = element("select", { "aria-label": "Speed" }, ...speeds);
    this.link = element("a", { class: "link" }, "Link to this view");
    this.saves = element("span", { class: "saves" }, this.link);
    container.replaceChildren(this.button, this.range, this.speed, this.clock, this.saves, ...this.#phaseStrip());
    this.set(0);
    document.addEventListener("keydown", (event) => this.#key(event));
    addEventListener("hashchange", () => this.linked());
  }

  // Go to the instant and the camera position that the address of the page contains.
  linked() {
    const parts = new URLSearchParams(location.hash.slice(1));
    const time = parts.get("t");
    if (time) this.at(Number(time));
    if (parts.get("view")) this.scene?.look(parts.get("view"));
    return time;
  }

  // Add a button beside the link.
  tool(text, onclick) {
    this.saves.append(element("button", { type: "button", class: "tool", onclick }, text));
  }

  // Call a function with the index of the shown instant, now and after every change.
  listen(listener) {
    this.listeners.push(listener);
    listener(this.index);
  }

  // Show the instant with an index of `times`.
  set(index) {
    this.index = Math.max(0, Math.min(this.times.length - 1, Math.round(index)));
    const t = this.times[this.index];
    const phase = this.phases.filter((candidate) => t >= candidate.start - 1e-9).pop();
    this.range.value = this.index;
    this.range.setAttribute("aria-valuetext", `${t.toFixed(3)} seconds${phase ? `, ${phase.name}` : ""}`);
    this.clock.textContent = `${t.toFixed(3)} s${phase ? ` · ${phase.name}` : ""}`;
    this.address();
    this.cursor.at(this.index / (this.times.length - 1));
    for (const listener of this.listeners) listener(this.index);
  }

  // Update the link to this instant and camera position.
  address() {
    this.link.href = `#t=${this.times[this.index].toFixed(5)}${this.scene?.renderer ? `&view=${this.scene.place()}` : ""}`;
  }

  // Return a strip below the slider with the phases, each with the longest form of its name that fits.
  // Screen readers skip it, because the slider announces the phase.
  #phaseStrip() {
    this.cursor = SSM.cursor();
    const parts = this.phases.map((phase) => SSM.bar("phase", phase.name, phase, this.times[0], this.times.at(-1)));
    const strip = element("div", { class: "track strip", "aria-hidden": "true", onpointerdown: (event) => this.point(event) }, ...parts, this.cursor.node);
    new ResizeObserver(() => parts.forEach((part, i) => { part.textContent = SSM.fitPhaseName(this.phases[i].name, part.clientWidth); })).observe(strip);
    return this.phases.length ? [strip] : [];
  }

  // Go to the position of the pointer on a track.
  point({ currentTarget, clientX }) {
    const { left, width } = currentTarget.getBoundingClientRect();
    this.pause();
    this.set(((this.times.length - 1) * (clientX - left)) / width);
  }

  // Show the instant closest to a time in s.
  at(time) {
    const step = this.times[1] - this.times[0];
    this.set((time - this.times[0]) / step);
  }

  toggle() {
    if (this.playing) return this.pause();
    if (this.index === this.times.length - 1) this.set(0);
    this.playing = true;
    this.button.textContent = "❚❚ Pause";
    let previous = performance.now();
    let t = this.times[this.index];
    const step = (now) => {
      if (!this.playing) return;
      t += ((now - previous) / 1000) * Number(this.speed.value);
      previous = now;
      this.at(t);
      if (t >= this.times.at(-1)) this.pause();
      else requestAnimationFrame(step);
    };
    requestAnimationFrame(step);
  }

  pause() {
    this.playing = false;
    this.button.textContent = "▶ Play";
  }

  #key(event) {
    const control = event.target.closest("input, select, button, textarea, summary, a");
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const move = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (event.key === " " && (!control || control === this.range)) this.toggle();
    else if (move && !control?.matches("input, select, textarea")) {
      this.pause();
      this.set(this.index + move * (event.shiftKey ? 50 : 5));
    } else return;
    event.preventDefault();
  }
};
