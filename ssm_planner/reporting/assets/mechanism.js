// The parts of a mechanism: axes, links as arcs about the RCM, tool, tilt bands, eye. Metres.
"use strict";
SSM.vector = (values) => new THREE.Vector3(...values);

// robot: base group, turns (three nested groups), slide, axes
SSM.mechanism = (scene, colours, ghost, labels) => {
  const axes = scene.axes.map(SSM.vector);
  const base = new THREE.Group();
  const turns = [0, 1, 2].map(() => new THREE.Group());
  const slide = new THREE.Group();
  base.add(turns[0]);
  turns[0].add(turns[1]);
  turns[1].add(turns[2]);
  turns[2].add(slide);
  const solid = (colour, opacity = ghost ? 0.35 : 1) =>
    new THREE.MeshLambertMaterial({ color: colour, opacity, transparent: opacity < 1, depthWrite: opacity === 1 });
  const out = axes[2].clone().multiplyScalar(-scene.insertion_sign);
  const ends = [axes[0].clone().multiplyScalar(scene.sides[0]), axes[1].clone().multiplyScalar(scene.sides[1]), out];
  const r = scene.link;
  const grey = ghost ? ["#c98a52", "#c98a52", "#c98a52"] : ["#5d6875", "#98a3b0", "#3c4650"];
  base.add(SSM.rod(ends[0], r - 0.012, r + 0.034, 0.014, solid(grey[2])));
  turns[0].add(SSM.arc(ends[0], ends[1], r, 0.0045, solid(grey[0])));
  turns[0].add(SSM.rod(ends[1], r - 0.016, r + 0.012, 0.01, solid(grey[2])));
  turns[1].add(SSM.arc(ends[1], out, r - 0.012, 0.004, solid(grey[1])));
  turns[1].add(SSM.rod(out, r - 0.024, r - 0.002, 0.007, solid(grey[2])));
  turns[2].add(SSM.rail(out, r, solid(grey[1])));
  slide.add(SSM.rod(out, r + 0.002, r + 0.016, 0.006, solid(ghost ? colours[1] : colours[2])));
  // within an eye nothing may look thicker than there is room for
  const fine = scene.eye ? 0.4 : 1;
  slide.add(SSM.rod(out, 0, r + 0.004, 0.0009 * fine, solid(ghost ? colours[1] : "#22272e", 1)));
  slide.add(SSM.ball(0.0013 * fine, solid(ghost ? colours[1] : "#7a2fa0", 1)));
  if (!ghost) {
    base.add(SSM.ball(0.0022 * fine, solid("#22272e")));
    [base, turns[0], turns[1]].forEach((parent, i) => parent.add(SSM.axisLine(axes[i], r + 0.03, colours[i])));
  }
  for (const band of ghost ? [] : scene.bands) base.add(SSM.band(band, -scene.insertion_sign, colours[1]));
  if (labels) {
    const words = [`1 ${scene.names[0]}`, `2 ${scene.names[1]}`, `3 ${scene.names[2]}, 4 ${scene.names[3]}`];
    [base, turns[0], turns[1]].forEach((parent, i) => {
      const label = SSM.label(words[i], colours[i]);
      label.position.copy(ends[i]).multiplyScalar(r + 0.046);
      parent.add(label);
    });
  }
  return { base, turns, slide, axes };
};

SSM.rod = (direction, from, to, radius, material) => {
  const rod = new THREE.Mesh(new THREE.CylinderGeometry(radius, radius, to - from, 20), material);
  rod.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), direction);
  rod.position.copy(direction).multiplyScalar((from + to) / 2);
  return rod;
};

SSM.ball = (radius, material) => new THREE.Mesh(new THREE.SphereGeometry(radius, 20, 14), material);

SSM.arc = (from, to, radius, thickness, material) => {
  const angle = from.angleTo(to);
  const normal = new THREE.Vector3().crossVectors(from, to);
  if (normal.length() < 1e-6) normal.set(from.y, -from.x, from.z || 1e-3);
  normal.normalize();
  const points = Array.from({ length: 25 }, (_, i) => from.clone().applyAxisAngle(normal, (angle * i) / 24).multiplyScalar(radius));
  return new THREE.Mesh(new THREE.TubeGeometry(new THREE.CatmullRomCurve3(points), 24, thickness, 10), material);
};

// beside the tool axis, so that the spin can be seen
SSM.rail = (out, r, material) => {
  const aside = new THREE.Vector3(0, 1, 0).addScaledVector(out, -out.y).normalize().multiplyScalar(0.011);
  const rail = SSM.rod(out, r - 0.02, r + 0.055, 0.0028, material);
  rail.position.add(aside);
  return rail;
};

SSM.axisLine = (axis, length, colour) => {
  const ends = [axis.clone().multiplyScalar(-length), axis.clone().multiplyScalar(length)];
  const material = new THREE.LineDashedMaterial({ color: colour, dashSize: 0.008, gapSize: 0.004 });
  const line = new THREE.Line(new THREE.BufferGeometry().setFromPoints(ends), material);
  line.computeLineDistances();
  return line;
};

SSM.band = ({ name, rows, columns, vertices }, side, colour) => {
  const geometry = new THREE.BufferGeometry();
  const allowed = name === "allowed";
  const scale = side * (allowed ? 1.004 : 1);
  geometry.setAttribute("position", new THREE.BufferAttribute(Float32Array.from(vertices, (x) => x * scale), 3));
  const faces = [];
  for (let i = 0; i + 1 < rows; i++) {
    for (let j = 0; j + 1 < columns; j++) {
      const a = i * columns + j;
      faces.push(a, a + 1, a + columns, a + 1, a + columns + 1, a + columns);
    }
  }
  geometry.setIndex(faces);
  const material = new THREE.MeshBasicMaterial({
    color: allowed ? colour : "#8fa3b8", opacity: allowed ? 0.3 : 0.22, transparent: true, side: THREE.DoubleSide, depthWrite: false,
  });
  return new THREE.Mesh(geometry, material);
};

SSM.tipPath = (points, colour, ghost) => {
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(Float32Array.from(points), 3));
  const material = ghost
    ? new THREE.LineDashedMaterial({ color: colour, dashSize: 0.001, gapSize: 0.0007 })
    : new THREE.LineBasicMaterial({ color: colour });
  const line = new THREE.Line(geometry, material);
  if (ghost) line.computeLineDistances();
  return line;
};

SSM.label = (text, colour) => {
  const canvas = SSM.element("canvas", { width: 360, height: 64 });
  const pen = canvas.getContext("2d");
  pen.font = "600 44px system-ui, sans-serif";
  pen.textAlign = "center";
  pen.textBaseline = "middle";
  pen.lineWidth = 8;
  pen.strokeStyle = "#ffffff";
  pen.strokeText(text, 180, 32, 352);
  pen.fillStyle = colour;
  pen.fillText(text, 180, 32, 352);
  const map = new THREE.CanvasTexture(canvas);
  map.colorSpace = "srgb";
  const label = new THREE.Sprite(new THREE.SpriteMaterial({ map, depthTest: false }));
  label.scale.set(0.1, 0.0178, 1);
  return label;
};

// eye: see values.Eye; base frame, the columns of the lens frame are the directions of its semi-axes
SSM.eye = (eye) => {
  const shell = (name, radius, colour, opacity) => {
    const material = new THREE.MeshBasicMaterial({ color: colour, opacity, transparent: true, depthWrite: false });
    const mesh = new THREE.Mesh(new THREE.SphereGeometry(radius, 32, 20), material);
    mesh.name = name;
    mesh.position.set(...eye.centre);
    return mesh;
  };
  const group = new THREE.Group();
  group.add(shell("retina", eye.radius, "#8fa3b8", 0.25));
  if (eye.clearance) group.add(shell("clearance", eye.radius - eye.clearance, "#b5482a", 0.12));
  if (eye.lens) {
    const lens = shell("lens", 1, "#2a7ab5", 0.4);
    lens.position.set(...eye.lens.centre);
    lens.scale.set(...eye.lens.semi_axes);
    const columns = [0, 1, 2].map((i) => SSM.vector(eye.lens.frame.map((row) => row[i])));
    lens.quaternion.setFromRotationMatrix(new THREE.Matrix4().makeBasis(...columns));
    group.add(lens);
  }
  return group;
};
