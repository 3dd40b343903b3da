// The mechanism in 3D. Nested groups are the product of exponentials: each turns about its axis at home.
"use strict";
SSM.Scene = class {
  // container: element; robots: [{scene, colours, path}]; path: Float64Array triples or null
  constructor(container, robots, { labels = true } = {}) {
    this.container = container;
    this.robots = [];
    this.waiting = false;
    this.frames = { slow: 0, lowered: false, last: 0 };
    this.labels = labels;
    this.views = { ...SSM.views };
    this.renderer = null;
    if (!document.createElement("canvas").getContext("webgl2")) {
      container.replaceChildren(SSM.element("p", { class: "fallback", role: "note" },
        "No 3D view: this browser offers no WebGL. Plots, values and tables below work without it."));
      return;
    }
    this.renderer = new THREE.WebGLRenderer({ antialias: true, powerPreference: "low-power" });
    this.renderer.setPixelRatio(1);
    this.renderer.setClearColor(0xf7f8fa);
    this.canvas = this.renderer.domElement;
    this.canvas.setAttribute("role", "img");
    this.canvas.setAttribute("aria-label", "The mechanism in 3D: drag to turn, wheel or pinch to zoom");
    this.note = SSM.element("p", { class: "scene-note", hidden: true });
    container.replaceChildren(this.canvas, this.note, this.#views());
    this.world = new THREE.Scene();
    this.world.add(new THREE.HemisphereLight(0xffffff, 0x8d97a5, 2.2));
    const sun = new THREE.DirectionalLight(0xffffff, 1.6);
    sun.position.set(0.3, -0.6, 0.8);
    this.world.add(sun);
    this.camera = new THREE.PerspectiveCamera(32, 1, 0.002, 5);
    this.camera.up.set(0, 0, 1);
    this.controls = new THREE.OrbitControls(this.camera, this.canvas);
    this.controls.enableDamping = false;
    this.controls.minDistance = 0.01;
    this.controls.maxDistance = 2;
    this.controls.addEventListener("change", () => this.render());
    this.canvas.addEventListener("webglcontextlost", () => this.#say("The browser has stopped the 3D view; reload the page to get it back."));
    for (const robot of robots) this.add(robot);
    this.look("whole");
    new ResizeObserver(() => this.#fit()).observe(container);
    this.#fit();
  }

  add({ scene, colours, path = null, ghost = false }) {
    if (!this.renderer) return;
    const robot = SSM.mechanism(scene, colours, ghost, this.labels && !ghost);
    if (path) robot.base.add(SSM.tipPath(path, ghost ? colours[1] : "#7a2fa0", ghost));
    this.world.add(robot.base);
    robot.eye = Boolean(scene.eye) && !this.robots.some((other) => other.eye);
    if (robot.eye) robot.base.add(SSM.eye(scene.eye));
    this.robots.push(robot);
    if (robot.eye && !this.views.eye) {
      const [x, y, z] = scene.eye.centre;
      this.views.eye = [[x - 0.012, y - 0.06, z + 0.018], [x, y, z + 0.002]];
      this.canvas.parentElement.querySelector(".views").append(this.#view("eye"));
    }
  }

  clear() {
    for (const robot of this.robots) {
      this.world.remove(robot.base);
      robot.base.traverse((part) => {
        part.geometry?.dispose();
        part.material?.map?.dispose();
        part.material?.dispose();
      });
    }
    this.robots = [];
  }

  // joints of the robot with this number, rad and m
  pose(number, q) {
    const robot = this.robots[number];
    if (!robot) return;
    robot.turns.forEach((turn, i) => turn.quaternion.setFromAxisAngle(robot.axes[i], q[i]));
    robot.slide.position.copy(robot.axes[2]).multiplyScalar(q[3]);
    this.render();
  }

  // tool tip in the base frame, m, as drawn
  tip(number) {
    const robot = this.robots[number];
    robot.base.updateMatrixWorld(true);
    return robot.slide.localToWorld(new THREE.Vector3()).toArray();
  }

  look(name) {
    const [from, to] = this.views[name];
    this.camera.position.set(...from);
    this.controls.target.set(...to);
    this.controls.update();
    this.render();
  }

  // draws once in the next frame, however often it is asked
  render() {
    if (this.waiting || !this.renderer) return;
    this.waiting = true;
    requestAnimationFrame((now) => {
      this.waiting = false;
      this.renderer.render(this.world, this.camera);
      this.#watch(now);
    });
  }

  // where frames follow each other too slowly to look smooth, fewer pixels are drawn, and the page says so
  #watch(now) {
    const spacing = now - this.frames.last;
    this.frames.last = now;
    if (spacing > 33 && spacing < 200) this.frames.slow += 1;
    else this.frames.slow = Math.max(0, this.frames.slow - 1);
    if (this.frames.slow < 15 || this.frames.lowered) return;
    this.frames.lowered = true;
    this.renderer.setPixelRatio(0.6);
    this.#say("Drawn with fewer pixels: this browser draws 3D in software, below 30 frames per second.");
    this.render();
  }

  #say(text) {
    this.note.textContent = text;
    this.note.hidden = false;
  }

  #views() {
    return SSM.element("div", { class: "views", role: "group", "aria-label": "Camera" }, ...Object.keys(this.views).map((name) => this.#view(name)));
  }

  #view(name) {
    return SSM.element("button", { type: "button", onclick: () => this.look(name) }, name);
  }

  #fit() {
    const { clientWidth, clientHeight } = this.container;
    if (!clientWidth || !clientHeight) return;
    this.renderer.setSize(clientWidth, clientHeight);
    this.camera.aspect = clientWidth / clientHeight;
    this.camera.updateProjectionMatrix();
    this.render();
  }
};

SSM.views = {
  whole: [[0.26, -0.44, 0.235], [-0.03, 0.0, 0.028]],
  front: [[0.56, 0, 0.03], [0, 0, 0.03]],
  side: [[-0.03, -0.56, 0.03], [-0.03, 0, 0.03]],
  top: [[-0.03, -0.001, 0.56], [-0.03, 0, 0]],
  tip: [[0.05, -0.1, 0.03], [0, 0, -0.008]],
};
