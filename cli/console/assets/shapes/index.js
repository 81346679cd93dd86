// The objects of the scene.
import { CSS2DObject, THREE } from "nicegui-scene";

const COLOURS = {
  floor: "#f4f6f8", grid: "#c9d1d9", cage: "#1f5fbf", trail: "#d1480c", body: "#24292f", nose: "#d1480c",
  rotor: "#57606a", goal: "#1a7f37", refused: "#b42318", aim: "#8250df", exclusion: "#b42318", inclusion: "#1a7f37",
  other: "#57606a",
};
const SIZE = 0.35; // m from the centre to a rotor as drawn, larger than the real vehicle to be visible

const lines = (points, colour, more = {}) =>
  new THREE.LineSegments(
    new THREE.BufferGeometry().setFromPoints(points.map((point) => new THREE.Vector3(...point))),
    new THREE.LineBasicMaterial({ color: colour, transparent: true, ...more }),
  );

function vehicle() {
  const group = new THREE.Group();
  const paint = (colour, opacity = 1) => new THREE.MeshLambertMaterial({ color: colour, transparent: opacity < 1, opacity });
  group.add(new THREE.Mesh(new THREE.BoxGeometry(0.26, 0.16, 0.09), paint(COLOURS.body)));
  for (const [sx, sy] of [[1, 1], [1, -1], [-1, 1], [-1, -1]]) {
    const [x, y] = [(sx * SIZE) / Math.SQRT2, (sy * SIZE) / Math.SQRT2];
    const arm = new THREE.Mesh(new THREE.BoxGeometry(SIZE, 0.035, 0.03), paint(COLOURS.body));
    arm.position.set(x / 2, y / 2, 0);
    arm.rotation.z = Math.atan2(sy, sx);
    const disc = new THREE.Mesh(new THREE.CylinderGeometry(0.17, 0.17, 0.012, 28), paint(sx > 0 ? COLOURS.nose : COLOURS.rotor, 0.75));
    disc.rotation.x = Math.PI / 2;
    disc.position.set(x, y, 0.05);
    group.add(arm, disc);
  }
  return group;
}

// A point in the air with a pole to the floor, which shows its position.
function mark(colour, radius, opacity = 0.9) {
  const group = new THREE.Group();
  const ball = new THREE.Mesh(new THREE.SphereGeometry(radius, 20, 14), new THREE.MeshBasicMaterial({ color: colour, transparent: true, opacity }));
  const pole = lines([[0, 0, 0], [0, 0, -1]], colour, { opacity: 0.5 });
  const foot = new THREE.Mesh(new THREE.RingGeometry(radius * 0.7, radius, 28), new THREE.MeshBasicMaterial({ color: colour, transparent: true, opacity: 0.6 }));
  group.add(ball, pole, foot);
  group.userData = { pole, foot };
  return group;
}

function place(group, at) {
  group.visible = Boolean(at);
  if (!at) return;
  group.position.set(...at);
  group.userData.pole.scale.z = Math.max(at[2], 0.001);
  group.userData.foot.position.z = 0.01 - at[2];
}

// The other vehicles of the run: dots with poles to the floor.
function others() {
  const dots = new THREE.Points(new THREE.BufferGeometry(), new THREE.PointsMaterial({ color: COLOURS.other, size: 7, sizeAttenuation: false }));
  const poles = lines([], COLOURS.other, { opacity: 0.25 });
  return new THREE.Group().add(dots, poles);
}

function spread(group, places) {
  const [dots, poles] = group.children;
  dots.material.size = Math.min(7, Math.max(2, 90 / Math.sqrt(places.length))); // px
  const feet = places.flatMap(([x, y, z]) => [[x, y, z], [x, y, 0]]);
  for (const [part, points] of [[dots, places], [poles, feet]]) {
    part.geometry.dispose();
    part.geometry = new THREE.BufferGeometry().setFromPoints(points.map((point) => new THREE.Vector3(...point)));
  }
}

function cross() {
  const [a, b] = [-0.14, 0.14];
  const group = lines([[a, a, a], [b, b, b], [a, b, a], [b, a, b], [a, a, b], [b, b, a], [a, b, b], [b, a, a]], COLOURS.refused);
  const foot = lines([[0, 0, 0], [0, 0, -1]], COLOURS.refused, { opacity: 0.35 });
  group.add(foot);
  group.userData = { foot };
  return group;
}

function label(text, more = "") {
  const element = document.createElement("span");
  element.className = `axis ${more}`;
  element.textContent = text;
  return new CSS2DObject(element);
}

// The floor and the cage, which is drawn faint while it is off.
function room(cage, on) {
  const made = new THREE.Group();
  const [x, y, z] = cage;
  const step = 10 ** Math.max(0, Math.ceil(Math.log10(Math.max(x, y) / 50))); // m between two lines
  const wide = step * Math.ceil((Math.max(x, y) * 1.6) / step);
  const floor = new THREE.Mesh(new THREE.PlaneGeometry(2 * wide, 2 * wide), new THREE.MeshBasicMaterial({ color: COLOURS.floor, depthWrite: false }));
  floor.position.z = -0.02;
  floor.renderOrder = -1; // before everything on it
  const grid = new THREE.GridHelper(2 * wide, (2 * wide) / step, COLOURS.grid, COLOURS.grid);
  grid.rotation.x = Math.PI / 2;
  grid.material.transparent = true;
  grid.material.opacity = 0.55;
  grid.material.depthWrite = false;
  grid.position.z = -0.01;
  const box = new THREE.BoxGeometry(2 * x, 2 * y, z);
  const edges = new THREE.LineSegments(new THREE.EdgesGeometry(box), new THREE.LineBasicMaterial({ color: on ? COLOURS.cage : COLOURS.rotor, transparent: true, opacity: on ? 0.9 : 0.22 }));
  const walls = new THREE.Mesh(box, new THREE.MeshBasicMaterial({ color: COLOURS.cage, transparent: true, opacity: on ? 0.05 : 0, side: THREE.BackSide, depthWrite: false }));
  edges.position.z = walls.position.z = z / 2;
  made.add(floor, grid, edges, walls);
  for (const [text, at] of [[`x ${-x}`, [-x, -y, 0]], [`x ${x}`, [x, -y, 0]], [`y ${y}`, [x, y, 0]], [`z ${z}`, [-x, -y, z]]]) {
    const words = label(text);
    words.position.set(...at);
    made.add(words);
  }
  return made;
}

const STEEP = 20; // degrees; a circle is drawn with flatter edges than this, which are not outlined

// A zone: walls that stay out are filled. Without a floor it begins on the ground, without a ceiling
// it ends as high as the cage. Grey while the cage is off.
function column({ name, kind, corners, circle, floor, ceiling }, cage, on) {
  const made = new THREE.Group();
  const low = Math.max(floor ?? 0, 0);
  const high = Math.max(ceiling ?? cage[2], low + 0.01);
  const ground = circle ? new THREE.Shape().absarc(...circle, 0, 2 * Math.PI) : new THREE.Shape(corners.map((at) => new THREE.Vector2(...at)));
  const body = new THREE.ExtrudeGeometry(ground, { depth: high - low, bevelEnabled: false, curveSegments: 24 });
  const colour = on ? COLOURS[kind] : COLOURS.rotor;
  const edges = new THREE.LineSegments(new THREE.EdgesGeometry(body, STEEP), new THREE.LineBasicMaterial({ color: colour, transparent: true, opacity: on ? 0.9 : 0.4 }));
  edges.position.z = low;
  made.add(edges);
  if (kind === "exclusion") {
    const walls = new THREE.Mesh(body, new THREE.MeshBasicMaterial({ color: colour, transparent: true, opacity: on ? 0.16 : 0.07, side: THREE.DoubleSide, depthWrite: false }));
    walls.position.z = low;
    made.add(walls);
  }
  const words = label(name, "zone");
  words.element.style.color = colour;
  body.computeBoundingBox();
  body.boundingBox.getCenter(words.position).setZ(high);
  made.add(words);
  return made;
}

export { COLOURS, column, cross, mark, others, place, room, spread, vehicle };
