// Build the parts of a mechanism for the 3D view: axes, links as arcs about the remote centre of motion (RCM), tool, tilt bands and eye.
// All lengths are in m.
"use strict";
const { BufferGeometry, Group, Mesh, MeshBasicMaterial, MeshLambertMaterial, SphereGeometry, Vector2, Vector3 } = THREE;

// Return the number of segments of a round part. Software rendering draws fewer, so that it reaches 60 frames per second.
SSM.segmentCount = (parts) => (SSM.rendersInSoftware ? Math.ceil(0.55 * parts) : parts);

SSM.vector = (values) => new Vector3(...values);

// Build a robot from a scene of html/scene.py. A ghost is a second motion: translucent, and without axes and labels. `base`, the three `turns` and `slide` are nested groups, which move with the joints.
SSM.mechanismModel = (scene, colours, ghost) => {
  const axes = scene.axes.map(SSM.vector);
  const base = new Group();
  const turns = [0, 1, 2].map(() => new Group());
  const slide = new Group();
  base.add(turns[0]);
  turns[0].add(turns[1]);
  turns[1].add(turns[2]);
  turns[2].add(slide);
  const solid = (colour, opacity = ghost ? 0.35 : 1) =>
    new MeshLambertMaterial({ color: colour, opacity, transparent: opacity < 1, depthWrite: opacity === 1 });
  const out = axes[2].clone().multiplyScalar(-scene.insertion_sign);
  const ends = [axes[0].clone().multiplyScalar(scene.sides[0]), axes[1].clone().multiplyScalar(scene.sides[1]), out];
  const frames = [base, turns[0], turns[1]];
  const r = scene.link;
  const grey = ghost ? ["#c98a52", "#c98a52", "#c98a52"] : ["#5d6875", "#98a3b0", "#3c4650"];
  base.add(SSM.rod(ends[0], r - 0.012, r + 0.034, 0.014, solid(grey[2])));
  turns[0].add(SSM.arc(ends[0], ends[1], r, 0.0045, solid(grey[0])));
  turns[0].add(SSM.rod(ends[1], r - 0.016, r + 0.012, 0.01, solid(grey[2])));
  turns[1].add(SSM.arc(ends[1], out, r - 0.012, 0.004, solid(grey[1])));
  turns[1].add(SSM.rod(out, r - 0.024, r - 0.002, 0.007, solid(grey[2])));
  turns[2].add(SSM.rail(out, r, solid(grey[1])));
  slide.add(SSM.rod(out, r + 0.002, r + 0.016, 0.006, solid(ghost ? colours[1] : colours[2])));
  // Inside an eye, the tool is drawn thinner, so that it does not hide the anatomy.
  const thinning = scene.eye ? 0.4 : 1;
  slide.add(SSM.rod(out, 0, r + 0.004, 0.0009 * thinning, solid(ghost ? colours[1] : "#22272e", 1)));
  slide.add(SSM.ball(0.0013 * thinning, solid(ghost ? colours[1] : "#7a2fa0", 1)));
  if (!ghost) base.add(SSM.ball(0.0022 * thinning, solid("#22272e")));
  // `parts` contains the objects of each entry of the legend. `texts` contains labels, each with the object at which it is placed.
  const parts = {};
  const put = (name, parent, ...objects) => {
    parent.add(...objects);
    parts[name] = [...(parts[name] ?? []), ...objects];
  };
  const texts = [];
  // `shown` is a function that decides by the scale in pixels per metre whether the label is visible.
  const say = (name, parent, position, text, colour, shown = () => true) => {
    const anchor = new Group();
    anchor.position.copy(position);
    put(name, parent, anchor);
    texts.push({ anchor, text, colour, name, shown });
  };
  if (!ghost) {
    frames.forEach((parent, i) => put("axes", parent, SSM.axisLine(axes[i], r + 0.03, colours[i])));
    for (const band of scene.bands) {
      const { lines, end } = SSM.bandLines(band, -scene.insertion_sign, colours[1]);
      put(`${band.name} tilt`, base, ...lines);
      if (band.name === "allowed") say("allowed tilt", base, end, "allowed tilt", colours[1]);
    }
    const degrees = (from, to) => `${fixed((180 / Math.PI) * from.angleTo(to), 1)}°`;
    const arcs = [["α", turns[0], ends[0], axes[1].clone().multiplyScalar(scene.sides[0]), 0.062, colours[0]],
      ["β", turns[1], ends[1], axes[2].clone().multiplyScalar(scene.sides[1]), 0.05, colours[2]]];
    for (const [name, parent, from, to, radius, colour] of arcs) {
      put("α and β", parent, SSM.arc(from, to, radius, 0.0007, new MeshBasicMaterial({ color: colour })));
      const middle = from.clone().add(to).setLength(radius);
      say("α and β", parent, middle, `${name} ${degrees(from, to)}`, colour);
    }
    const words = [`1 ${scene.names[0]}`, `2 ${scene.names[1]}`, `3 ${scene.names[2]}, 4 ${scene.names[3]}`];
    frames.forEach((parent, i) => say("axes", parent, ends[i].clone().multiplyScalar(r + 0.03), words[i], colours[i]));
    say("axes", base, new Vector3(), scene.eye ? "RCM, port" : "RCM", "#000000");
  }
  return { base, turns, slide, axes, parts, put, say, texts };
};

// Turn the y axis of a part into a direction, and move its origin by a distance in this direction from a place.
SSM.placeAlong = (part, direction, distance = 0, place = new Vector3()) => {
  part.quaternion.setFromUnitVectors(new Vector3(0, 1, 0), direction);
  part.position.copy(place).addScaledVector(direction, distance);
  return part;
};

SSM.rod = (direction, from, to, radius, material) =>
  SSM.placeAlong(new Mesh(new THREE.CylinderGeometry(radius, radius, to - from, SSM.segmentCount(20)), material), direction, (from + to) / 2);

SSM.ball = (radius, material) => new Mesh(new SphereGeometry(radius, SSM.segmentCount(12), SSM.segmentCount(8)), material);

SSM.arc = (from, to, radius, thickness, material) => {
  const angle = from.angleTo(to);
  const normal = new Vector3().crossVectors(from, to);
  if (normal.length() < 1e-6) normal.set(from.y, -from.x, from.z || 1e-3);
  normal.normalize();
  const points = Array.from({ length: 25 }, (_, i) => from.clone().applyAxisAngle(normal, (angle * i) / 24).multiplyScalar(radius));
  return new Mesh(new THREE.TubeGeometry(new THREE.CatmullRomCurve3(points), SSM.segmentCount(24), thickness, SSM.segmentCount(10)), material);
};

// Build a rail beside the tool axis, which makes the spin visible.
SSM.rail = (out, r, material) => {
  const aside = new Vector3(0, 1, 0).addScaledVector(out, -out.y).normalize().multiplyScalar(0.011);
  const rail = SSM.rod(out, r - 0.02, r + 0.055, 0.0028, material);
  rail.position.add(aside);
  return rail;
};

// Build a line. `dash` is the length of a dash, or 0 for a solid line.
SSM.line = (points, colour, dash = 0) =>
  new THREE.Line(new BufferGeometry().setFromPoints(points),
    new THREE.LineDashedMaterial({ color: colour, dashSize: dash || 1, gapSize: dash / 2 })).computeLineDistances();

SSM.axisLine = (axis, length, colour) => SSM.line([-length, length].map((x) => axis.clone().multiplyScalar(x)), colour, 0.008);

// Build the edges of a range of tilts and the meridian between them as thin lines.
SSM.bandLines = ({ name, rows, columns, vertices }, side, colour) => {
  const scale = side * (name === "allowed" ? 1.004 : 1);
  const at = (row, column) => new Vector3().fromArray(vertices, 3 * (row * columns + column)).multiplyScalar(scale);
  const [middle, last] = [columns >> 1, rows - 1];
  const paint = name === "allowed" ? colour : "#8793a0";
  const thin = (points, radius) => new Mesh(new THREE.TubeGeometry(new THREE.CatmullRomCurve3(points), 2 * points.length, radius, 6),
    new MeshBasicMaterial({ color: paint }));
  const along = (row) => Array.from({ length: columns }, (_, j) => at(row, j));
  const lines = [0, last].map((row) => SSM.line(along(row), paint));
  lines.push(thin(Array.from({ length: rows }, (_, i) => at(i, middle)), name === "allowed" ? 0.0014 : 0.0007));
  return { lines, end: at(last, middle) };
};

// Build markers of the positions at which a phase ends and the tool rests: the spots of a scan, and other stops.
SSM.stopMarkers = (points) => [true, false].map((spots) => {
  const ball = new SphereGeometry(spots ? 0.00028 : 0.0004, SSM.segmentCount(12), SSM.segmentCount(8));
  const [corners, order] = [[...ball.attributes.position.array], [...ball.index.array]];
  const some = points.filter(({ spot }) => spot === spots);
  const together = new BufferGeometry(); // all markers are one geometry, which is drawn at once
  const vertices = some.flatMap(({ position }) => corners.map((value, i) => value + position[i % 3]));
  together.setAttribute("position", new THREE.BufferAttribute(new Float32Array(vertices), 3));
  together.setIndex(some.flatMap((_, k) => order.map((i) => i + (k * corners.length) / 3)));
  return new Mesh(together, new MeshBasicMaterial({ color: spots ? "#1fae5b" : "#e0a100" }));
});

// Build an eye from a value of the class Eye in problem/problem.py, in the base frame. The columns of the lens frame are the directions of its
// semi-axes. `paint` is the colour of all surfaces, or a false value for individual colours. Retina, clearance and lens are those of the plan.
// Sclera, cornea, iris and macula have usual sizes and only illustrate the eye.
SSM.eyeModel = (eye, paint) => {
  const group = new Group();
  const centre = SSM.vector(eye.centre);
  const front = (eye.lens ? SSM.vector(eye.lens.centre).sub(centre) : centre.clone().negate()).normalize();
  const surface = (name, radius, colour, { opacity = 1, side = 0, from = 0, to = Math.PI, at = 0, light = true } = {}) => {
    const options = { color: paint || colour, opacity, transparent: opacity < 1, depthWrite: opacity === 1, side };
    const material = light ? new MeshLambertMaterial(options) : new MeshBasicMaterial(options);
    const mesh = new Mesh(new SphereGeometry(radius, SSM.segmentCount(40), SSM.segmentCount(24), 0, 2 * Math.PI, from, to - from), material);
    mesh.name = name;
    group.add(SSM.placeAlong(mesh, front, at, centre));
    return mesh;
  };
  // The far half of the eye (retina) is opaque enough for a background. The near half (sclera) is almost transparent.
  const outer = eye.radius + 0.0006;
  const limbus = 0.0058; // half the usual width of a cornea
  const opening = Math.asin(Math.min(0.9, limbus / outer));
  surface("retina", eye.radius, "#e0704d", { opacity: 0.5, side: 1, from: opening });
  surface("sclera", outer, "#f4f1ea", { opacity: 0.22, from: opening });
  const bulge = 0.0078; // usual radius of a cornea
  const half = Math.asin(limbus / bulge);
  surface("cornea", bulge, "#9cc7e8", { opacity: 0.3, side: 2, to: half, at: outer * Math.cos(opening) - bulge * Math.cos(half) });
  const iris = new Mesh(new THREE.LatheGeometry([new Vector2(0.0022, 0), new Vector2(limbus - 0.0003, 0)], SSM.segmentCount(40)),
    new MeshBasicMaterial({ color: "#4f7f6a", side: 2, opacity: 0.55, transparent: true, depthWrite: false }));
  const disc = eye.lens ? SSM.vector(eye.lens.centre).distanceTo(centre) + Math.min(...eye.lens.semi_axes) : outer * Math.cos(opening);
  const macula = SSM.ball(0.0012, new MeshBasicMaterial({ color: "#8c2d1a" }));
  macula.scale.y = 0.15;
  const port = new Mesh(new THREE.LatheGeometry([[7, -4], [11, -4], [11, 4], [7, 4]].map(([x, y]) => new Vector2(x / 1e4, y / 1e4)), 24),
    new MeshLambertMaterial({ color: "#3c4650", side: 2 }));
  group.add(SSM.placeAlong(iris, front, disc, centre), SSM.placeAlong(macula, front, -eye.radius, centre), SSM.placeAlong(port, centre.clone().normalize()));
  const places = [["macula", macula.position, "#8c2d1a"], ["retina", centre.clone().addScaledVector(new Vector3(0, -1, 0), eye.radius), "#a8482c"]];
  const edges = [];
  if (eye.clearance) edges.push(surface("clearance", eye.radius - eye.clearance, "#b5482a", { opacity: 0.1, light: false }));
  if (eye.lens) {
    const lens = surface("lens", 1, "#2a7ab5", { opacity: 0.45 });
    lens.position.set(...eye.lens.centre);
    lens.scale.set(...eye.lens.semi_axes);
    const columns = [0, 1, 2].map((i) => SSM.vector(eye.lens.frame.map((row) => row[i])));
    lens.quaternion.setFromRotationMatrix(new THREE.Matrix4().makeBasis(...columns));
    places.push(["lens", lens.position, "#1c5f92"]);
  }
  return { group, places, edges };
};
