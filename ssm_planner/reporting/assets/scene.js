// The mechanism in 3D. Each joint is a group that turns about its axis at the home position, and contains the groups of the following joints.
// This nesting corresponds to the product of exponentials.
"use strict";
SSM.Scene = class {
  // `container` is an element. `robots` contains {scene, colours, path} for each robot, see `add`. `path` contains positions of the tip, or is null.
  constructor(container, robots) {
    this.container = container;
    this.robots = [];
    this.waiting = false;
    this.frames = { slow: 0, lowered: false, last: 0 };
    this.hidden = new Set(["clearance"]);
    this.texts = [];
    this.size = [1, 1];
    this.views = { ...SSM.views };
    this.renderer = null;
    if (!document.createElement("canvas").getContext("webgl2")) {
      container.replaceChildren(element("p", { class: "fallback", role: "note" },
        "No 3D view, because this browser has no WebGL. Plots, values and tables below work without it."));
      return;
    }
    SSM.rendersInSoftware = SSM.detectSoftwareRendering();
    this.ratio = Math.min(devicePixelRatio, 2);
    this.renderer = new THREE.WebGLRenderer({ antialias: !SSM.rendersInSoftware, powerPreference: "low-power" });
    this.renderer.setPixelRatio(this.ratio);
    this.canvas = this.renderer.domElement;
    for (const [name, value] of [["role", "application"], ["tabindex", 0], ["aria-roledescription", "3D view"],
      ["aria-label", "The mechanism in 3D: drag or use arrow keys to turn; use the wheel, pinch, plus or minus to zoom; press 0 to show everything"]]) {
      this.canvas.setAttribute(name, value);
    }
    this.canvas.addEventListener("keydown", (event) => this.#key(event));
    this.note = element("p", { class: "scene-note", hidden: true });
    this.overlay = element("div", { class: "labels", "aria-hidden": "true" });
    this.legend = element("details", { class: "scene-legend", open: container.clientWidth > 560 && container.clientHeight > 500 }, element("summary", {}, "Legend"));
    this.legend.addEventListener("toggle", () => { this.#updateCovered(); this.render(); });
    this.inset = element("div", { class: "inset", "aria-hidden": "true" });
    this.covering = [this.#viewButtons(), this.legend, this.inset];
    this.covered = [];
    container.replaceChildren(this.canvas, this.overlay, this.note, ...this.covering);
    this.world = new THREE.Scene();
    this.world.add(new THREE.HemisphereLight(0xffffff, 0x8d97a5, 2.2));
    const sun = new THREE.DirectionalLight(0xffffff, 1.6);
    sun.position.set(0.3, -0.6, 0.8);
    this.world.add(sun);
    [this.camera, this.overview] = [0, 1].map(() => new THREE.PerspectiveCamera(32, 1, 0.002, 5));
    for (const camera of [this.camera, this.overview]) camera.up.set(0, 0, 1);
    this.overview.position.set(...this.views.whole[0]);
    this.overview.lookAt(...this.views.whole[1]);
    this.controls = new THREE.OrbitControls(this.camera, this.canvas);
    this.controls.enableDamping = false;
    this.controls.minDistance = 0.01;
    this.controls.maxDistance = 2;
    this.controls.addEventListener("change", () => this.render());
    this.canvas.addEventListener("webglcontextlost", () => this.#showNote("The browser has stopped the 3D view; reload the page to restart it."));
    this.look("whole");
    for (const robot of robots) this.add(robot);
    SSM.onRedraw(() => this.#redraw());
    this.#redraw();
    new ResizeObserver(() => this.#resize()).observe(container);
    this.#resize();
  }

  // Add a robot. `stops` contains {position, spot} for each stop of the tip. `begin` contains the joint positions at the start (rad and m),
  // at which the robot is also drawn faintly.
  add({ scene, colours, path = null, ghost = false, stops = [], begin = null }) {
    if (!this.renderer) return;
    const robot = SSM.mechanismModel(scene, colours, ghost);
    if (path) robot.put("tip trace", robot.base, SSM.line(path, ghost ? colours[1] : "#9a4fc4", ghost * 0.0012));
    if (stops.length) robot.put(stops.some(({ spot }) => spot) ? "spots" : "stops", robot.base, ...SSM.stopMarkers(stops));
    this.world.add(robot.base);
    // An eye that both robots have is drawn once.
    robot.eye = JSON.stringify(scene.eye);
    const isNewEye = scene.eye && !this.robots.some(({ eye }) => eye === robot.eye);
    if (isNewEye) {
      const { group, places, edges } = SSM.eyeModel(scene.eye, ghost && colours[1]);
      robot.put("eye", robot.base, group);
      if (edges.length) robot.parts.clearance = edges;
      // The parts of the eye have labels only if the eye is large on the screen.
      const large = (perMetre) => scene.eye.radius * perMetre > 60;
      for (const [text, position, colour] of places) robot.say("eye", robot.base, position, text, ghost ? colours[1] : colour, large);
      robot.say("eye", robot.base, SSM.vector(scene.eye.centre), "eye", "#a8482c", (perMetre) => !large(perMetre));
    }
    if (begin) {
      const start = SSM.mechanismModel(scene, colours, true);
      start.base.traverse(({ material }) => material?.setValues({ color: "#77828e", transparent: true, opacity: 0.22, depthWrite: false }));
      SSM.setJoints(start, begin);
      robot.put("start", robot.base, start.base);
    }
    this.robots.push(robot);
    for (const text of robot.texts) {
      const node = element("span", {}, text.text);
      node.style.borderColor = SSM.cssColour(text.colour);
      this.overlay.append(node);
      this.texts.push({ ...text, node, size: [node.offsetWidth, node.offsetHeight] });
    }
    this.#updateLegend();
    const view = this.views.eye && ghost ? "eye B" : "eye";
    if (isNewEye && !this.views[view]) {
      const [x, y, z] = scene.eye.centre;
      this.views[view] = [[x - 0.012, y - 0.06, z + 0.018], [x, y, z + 0.002]];
      this.container.querySelector(".views").append(this.#viewButton(view));
      this.first ??= view;
      this.look(this.first);
    }
  }

  clear() {
    for (const robot of this.robots) {
      this.world.remove(robot.base);
      robot.base.traverse((part) => {
        part.geometry?.dispose();
        part.material?.dispose();
      });
    }
    this.robots = [];
    this.texts = [];
    this.overlay?.replaceChildren();
  }

  // Move the robot with this number to joint positions q, rad and m.
  pose(number, q) {
    const robot = this.robots[number];
    if (!robot) return;
    SSM.setJoints(robot, q);
    this.render();
  }

  // Return the drawn position of the tool tip in the base frame, m.
  tip(number) {
    const robot = this.robots[number];
    robot.base.updateMatrixWorld(true);
    return robot.slide.localToWorld(new Vector3()).toArray();
  }

  // Set the camera to a named view, or to the text that place() returned.
  look(name) {
    const numbers = name.split(",").map(Number);
    const [from, to] = this.views[name] ?? [numbers.slice(0, 3), numbers.slice(3)];
    if (!this.renderer || to.length !== 3 || ![...from, ...to].every(Number.isFinite)) return;
    this.camera.position.set(...from);
    this.controls.target.set(...to);
    this.controls.update();
    this.inset.hidden = !this.views.eye || this.controls.target.distanceTo(SSM.vector(this.views.eye[1])) > 1e-5;
    this.#updateCovered();
    this.render();
  }

  // Return the positions of the camera and of its target as text, m.
  place() {
    return [...this.camera.position.toArray(), ...this.controls.target.toArray()].map((x) => Number(x.toFixed(6))).join();
  }

  // Save the picture without its labels.
  picture() {
    this.#draw();
    this.canvas.toBlob((blob) => SSM.download("motion.png", blob, blob.type));
  }

  // Draw once in the next frame, even if the method is called several times.
  render() {
    if (this.waiting || !this.renderer) return;
    this.waiting = true;
    requestAnimationFrame((now) => {
      this.waiting = false;
      if (this.renderer.getPixelRatio() !== this.ratio) this.renderer.setPixelRatio(this.ratio);
      this.#draw();
      this.#watchFrameRate(now);
      if (SSM.rendersInSoftware) this.#refineAtRest();
    });
  }

  // Software rendering is only fast enough without smooth edges. At rest, a picture with twice the resolution replaces the last one.
  #refineAtRest() {
    clearTimeout(this.resting);
    this.resting = setTimeout(() => {
      this.renderer.setPixelRatio(2 * Math.max(1, this.ratio));
      this.#draw();
    }, 120);
  }

  #draw() {
    this.renderer.render(this.world, this.camera);
    this.#placeLabels();
    const { offsetLeft, offsetTop, offsetWidth, offsetHeight } = this.inset;
    if (!offsetWidth || SSM.isPrinting) return;
    const box = [offsetLeft, this.size[1] - offsetTop - offsetHeight, offsetWidth, offsetHeight];
    this.overview.aspect = offsetWidth / offsetHeight;
    this.overview.updateProjectionMatrix();
    this.renderer.setScissorTest(true);
    this.renderer.setScissor(...box);
    this.renderer.setViewport(...box);
    this.renderer.render(this.world, this.overview);
    this.renderer.setScissorTest(false);
    this.renderer.setViewport(0, 0, ...this.size);
  }

  // Store the areas of elements in front of the picture, which labels must avoid.
  #updateCovered() {
    this.covered = this.covering.map((each) => [
      each.offsetLeft, each.offsetTop, each.offsetLeft + each.offsetWidth, each.offsetTop + each.offsetHeight]);
  }

  // Place each label beside its anchor, where it does not overlap another label. A label without such a place is hidden.
  #placeLabels() {
    const [width, height] = this.size;
    const point = new Vector3();
    const taken = [...this.covered];
    const perMetre = height / (2 * Math.tan((this.camera.fov * Math.PI) / 360) * this.camera.position.distanceTo(this.controls.target));
    for (const { anchor, node, size, name, shown } of this.texts) {
      point.setFromMatrixPosition(anchor.matrixWorld).project(this.camera);
      const [x, y] = [((point.x + 1) * width) / 2, ((1 - point.y) * height) / 2];
      const seen = shown(perMetre) && !this.hidden.has(name) && point.z < 1 && x > 0 && x < width && y > 0 && y < height;
      const [w, h] = size;
      const free = ([left, top]) => left >= 2 && left + w <= width - 2 && top >= 2 && top + h <= height - 2 &&
        taken.every(([a, b, c, d]) => left + w < a || left > c || top + h < b || top > d);
      const choices = [0, 1, 2, 3].flatMap((k) => [[x + 7, y - h - 2 - k * h], [x - w - 7, y - h - 2 - k * h], [x + 7, y + 3 + k * h], [x - w - 7, y + 3 + k * h]]);
      const chosen = seen && choices.find(free);
      node.style.visibility = chosen ? "visible" : "hidden";
      if (!chosen) continue;
      node.style.transform = `translate(${chosen[0]}px, ${chosen[1]}px)`;
      taken.push([chosen[0], chosen[1], chosen[0] + w, chosen[1] + h]);
    }
  }

  // If frames follow each other too slowly to look smooth, reduce the resolution and show a note.
  #watchFrameRate(now) {
    const spacing = now - this.frames.last;
    this.frames.last = now;
    if (spacing > 33 && spacing < 200) this.frames.slow += 1;
    else this.frames.slow = Math.max(0, this.frames.slow - 1);
    if (this.frames.slow < 15 || this.frames.lowered) return;
    this.frames.lowered = true;
    this.ratio = 0.6;
    this.#showNote("Drawn with fewer pixels: this browser draws 3D in software, below 30 frames per second.");
    this.render();
  }

  #showNote(text) {
    this.note.textContent = text;
    this.note.hidden = false;
  }

  // Draw with the colours of the scheme. For printing, add a copy, because the content of a WebGL canvas is lost when the page is printed.
  #redraw() {
    this.renderer.setClearColor(themeColour("scene"));
    this.#draw();
    this.container.querySelector(".paper")?.remove();
    if (!SSM.isPrinting) return;
    const { width, height } = this.canvas;
    const copy = element("canvas", { class: "paper", width, height, role: "img", "aria-label": "The mechanism" });
    copy.getContext("2d").drawImage(this.canvas, 0, 0);
    this.container.append(copy);
  }

  #key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const step = Math.PI / 24;
    const turn = { ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, step], ArrowDown: [0, -step] }[event.key];
    const zoom = { "+": 0.85, "=": 0.85, "-": 1 / 0.85 }[event.key];
    if (event.key === "0") this.look(this.first ?? "whole");
    else if (turn || zoom) {
      const away = this.camera.position.clone().sub(this.controls.target);
      const length = away.length() * (zoom ?? 1);
      const azimuth = Math.atan2(away.y, away.x) + (turn?.[0] ?? 0);
      const height = Math.max(-1.5, Math.min(1.5, Math.asin(away.z / away.length()) + (turn?.[1] ?? 0)));
      away.set(Math.cos(height) * Math.cos(azimuth), Math.cos(height) * Math.sin(azimuth), Math.sin(height)).multiplyScalar(length);
      this.camera.position.copy(this.controls.target).add(away);
      this.controls.update();
      this.render();
    } else return;
    event.preventDefault();
    event.stopPropagation();
  }

  #updateLegend() {
    const names = [...new Set(this.robots.flatMap(({ parts }) => Object.keys(parts)))];
    this.#applyVisibility();
    if (names.join() === this.named) return;
    this.named = names.join();
    const entry = (name) => {
      const box = element("input", { type: "checkbox", checked: !this.hidden.has(name), onchange: () => {
        if (box.checked) this.hidden.delete(name);
        else this.hidden.add(name);
        this.#applyVisibility();
        this.render();
      } });
      return element("label", {}, box, name);
    };
    this.legend.replaceChildren(this.legend.firstChild, ...names.map(entry));
    this.#updateCovered();
  }

  #applyVisibility() {
    for (const { parts } of this.robots) {
      for (const [name, objects] of Object.entries(parts)) objects.forEach((each) => { each.visible = !this.hidden.has(name); });
    }
  }

  #viewButtons() {
    return element("div", { class: "views", role: "group", "aria-label": "Camera" }, ...Object.keys(this.views).map((name) => this.#viewButton(name)));
  }

  #viewButton(name) {
    return element("button", { type: "button", onclick: () => this.look(name) }, name);
  }

  #resize() {
    const { clientWidth, clientHeight } = this.container;
    if (!clientWidth || !clientHeight || SSM.isPrinting) return;
    this.size = [clientWidth, clientHeight];
    this.#updateCovered();
    this.renderer.setSize(clientWidth, clientHeight);
    this.camera.aspect = clientWidth / clientHeight;
    // In an upright frame, the field of view is as wide as in a square one.
    this.camera.fov = this.camera.aspect < 1 ? (2 * Math.atan(Math.tan((32 * Math.PI) / 360) / this.camera.aspect) * 180) / Math.PI : 32;
    this.camera.updateProjectionMatrix();
    this.render();
  }
};

// Return true if the browser renders 3D graphics in software, without a graphics processor.
SSM.detectSoftwareRendering = () => {
  const gl = document.createElement("canvas").getContext("webgl2");
  const about = gl?.getExtension("WEBGL_debug_renderer_info");
  const software = /swiftshader|llvmpipe|software|basic render/i.test(about ? gl.getParameter(about.UNMASKED_RENDERER_WEBGL) : "");
  gl?.getExtension("WEBGL_lose_context")?.loseContext();
  return software;
};

SSM.setJoints = ({ turns, slide, axes }, q) => {
  turns.forEach((turn, i) => turn.quaternion.setFromAxisAngle(axes[i], q[i]));
  slide.position.copy(axes[2]).multiplyScalar(q[3]);
};

SSM.views = {
  whole: [[0.26, -0.44, 0.235], [-0.03, 0.0, 0.028]],
  front: [[0.56, 0, 0.03], [0, 0, 0.03]],
  side: [[-0.03, -0.56, 0.03], [-0.03, 0, 0.03]],
  top: [[-0.03, -0.001, 0.56], [-0.03, 0, 0]],
  tip: [[0.05, -0.1, 0.03], [0, 0, -0.008]],
};
