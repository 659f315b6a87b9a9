"use strict";
// Draws VIEW (see view3d.py) with three.js.  The world is z-up; `#120` opens the page at frame 120.

function bytes(text) {
  return Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)).buffer;
}
const floats = (text) => new Float32Array(bytes(text));
const isKnown = (values) => values.every(Number.isFinite);
const rows = (values, width) =>
  Array.from({ length: values.length / width }, (_, i) => values.subarray(i * width, (i + 1) * width));

const dark = matchMedia("(prefers-color-scheme: dark)").matches;
const box = document.getElementById("view");
const slider = document.getElementById("time");
const scene = new THREE.Scene();
scene.background = new THREE.Color(dark ? 0x14171a : 0xffffff);
scene.add(new THREE.HemisphereLight(0xffffff, 0x777777, 0.9));
const lamp = new THREE.DirectionalLight(0xffffff, 0.6);
scene.add(lamp);

const people = VIEW.people.map((one) => ({ ...one, path: rows(floats(one.pelvis), 3) }));
const poses = VIEW.camera ? rows(floats(VIEW.camera.world_from_cam), 16) : [];
const centre = (pose) => new THREE.Vector3(pose[3], pose[7], pose[11]);
const centres = poses.filter(isKnown).map(centre);

// What decides the view: the people, and the camera's path; stray points far away do not.
const middle = new THREE.Box3();
for (const one of people) one.path.filter(isKnown).forEach((p) => middle.expandByPoint(new THREE.Vector3(...p)));
if (middle.isEmpty()) centres.forEach((p) => middle.expandByPoint(p));
const all = middle.clone();
centres.forEach((p) => all.expandByPoint(p));
const target = middle.getCenter(new THREE.Vector3());
const reach = Math.max(all.getSize(new THREE.Vector3()).length(), people.length ? 3 : 1e-3);

function line(points, colour, opacity = 1) {
  const material = new THREE.LineBasicMaterial({ color: colour, transparent: opacity < 1, opacity });
  return new THREE.Line(new THREE.BufferGeometry().setFromPoints(points), material);
}

// A path as its unbroken stretches.
function addPath(places, colour) {
  let stretch = [];
  for (const place of [...places, null]) {
    if (place) stretch.push(place);
    else if (stretch.length) { scene.add(line(stretch, colour)); stretch = []; }
  }
}

function frustum(colour, size, opacity) {
  const [w, h] = VIEW.camera.half.map((half) => half * size);
  const corners = [[-w, -h], [w, -h], [w, h], [-w, h]].map(([x, y]) => new THREE.Vector3(x, y, size));
  const eye = new THREE.Vector3();
  const points = corners.flatMap((corner, i) => [eye, corner, corner, corners[(i + 1) % 4]]);
  const material = new THREE.LineBasicMaterial({ color: colour, transparent: true, opacity });
  const made = new THREE.LineSegments(new THREE.BufferGeometry().setFromPoints(points), material);
  made.matrixAutoUpdate = false;
  return made;
}

function addPoints() {
  const places = floats(VIEW.points);
  if (!places.length) return;
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(places, 3));
  const look = { color: VIEW.colours.muted, size: 1.5, sizeAttenuation: false };
  scene.add(new THREE.Points(geometry, new THREE.PointsMaterial(look)));
}

function addFloor() {
  const size = Math.max(4, 2 * Math.ceil(reach));
  const colours = dark ? [0x3a4147, 0x262b30] : [0xc4c9ce, 0xe2e4e6];
  const grid = new THREE.GridHelper(size, size, ...colours);
  grid.rotation.x = Math.PI / 2;
  grid.position.set(Math.round(target.x), Math.round(target.y), 0);
  scene.add(grid);
}

// Two standard errors of the place to either side, frame by frame: together a tube round the path.
function addTube(one) {
  const sigmas = rows(floats(one.sigma), 3);
  const known = sigmas.map((_, i) => i).filter((i) => isKnown(one.path[i]) && isKnown(sigmas[i]));
  const material = new THREE.MeshBasicMaterial({ color: one.colour, transparent: true, opacity: 0.06, depthWrite: false });
  const balls = new THREE.InstancedMesh(new THREE.SphereGeometry(1, 12, 8), material, known.length);
  known.forEach((i, number) => {
    const matrix = new THREE.Matrix4().makeScale(...sigmas[i].map((s) => Math.max(2 * s, 1e-4)));
    balls.setMatrixAt(number, matrix.setPosition(...one.path[i]));
  });
  balls.frustumCulled = false;
  scene.add(balls);
}

function addPerson(one) {
  addPath(one.path.map((p) => (isKnown(p) ? new THREE.Vector3(...p) : null)), one.colour);
  if (one.sigma) addTube(one);
  one.dot = new THREE.Mesh(new THREE.SphereGeometry(0.04, 16, 12), new THREE.MeshBasicMaterial({ color: one.colour }));
  scene.add(one.dot);
  if (!one.glb) return;
  new THREE.GLTFLoader().parse(bytes(one.glb), "", (made) => {
    made.scene.rotation.x = Math.PI / 2; // glTF is y-up
    made.scene.traverse((node) => {
      node.frustumCulled = false;
      if (node.isMesh) node.material.color.set(one.colour).lerp(new THREE.Color(0xffffff), 0.35);
    });
    one.mixer = new THREE.AnimationMixer(made.scene);
    one.mixer.clipAction(made.animations[0]).play();
    one.end_s = made.animations[0].duration;
    one.body = made.scene;
    scene.add(made.scene);
    show();
  });
}

addPoints();
if (people.length) addFloor();
people.forEach(addPerson);
let filming = null;
if (VIEW.camera) {
  const size = people.length ? 0.35 : reach / 12;
  addPath(poses.map((pose) => (isKnown(pose) ? centre(pose) : null)), VIEW.colours.camera);
  const step = Math.ceil(poses.length / 14);
  poses.forEach((pose, i) => {
    if (i % step || !isKnown(pose)) return;
    const still = frustum(VIEW.colours.camera, size * 0.5, 0.35);
    still.matrix.set(...pose);
    scene.add(still);
  });
  filming = frustum(VIEW.colours.camera, size, 1);
  scene.add(filming);
}

const renderer = new THREE.WebGLRenderer({ antialias: true, preserveDrawingBuffer: true });
renderer.setPixelRatio(devicePixelRatio);
box.appendChild(renderer.domElement);
const eye = new THREE.PerspectiveCamera(45, 1, reach / 1000, reach * 100);
const controls = new THREE.TrackballControls(eye, renderer.domElement);
controls.rotateSpeed = 2.5;
controls.staticMoving = true;
controls.target.copy(target);

// From where it was filmed, a bit further off and higher.
function stand() {
  const first = centres.length && people.length ? centres[0] : new THREE.Vector3(target.x - 0.6 * reach, target.y - reach, target.z);
  const away = first.clone().sub(target);
  away.z = 0;
  if (away.length() < 1e-6) away.set(0, -1, 0);
  eye.position.copy(target).addScaledVector(away.normalize(), 0.95 * reach);
  eye.position.z += 0.4 * reach;
  eye.up.set(0, 0, 1);
  eye.lookAt(target);
}

function show() {
  const row = Number(slider.value);
  const frame = VIEW.frames[row];
  for (const one of people) {
    const known = isKnown(one.path[row]);
    one.dot.visible = known && !one.body;
    if (known) one.dot.position.set(...one.path[row]);
    if (!one.body) continue;
    one.mixer.setTime(Math.min(frame / one.fps_hz, one.end_s - 1e-4));
    one.body.visible = known;
    one.body.traverse((node) => {
      if (!node.isMesh) return;
      node.material.transparent = true;
      node.material.opacity = one.seen[row] ? 1 : 0.35;
    });
  }
  if (filming) {
    filming.visible = isKnown(poses[row]);
    if (filming.visible) filming.matrix.set(...poses[row]);
  }
  document.getElementById("now").value = `frame ${frame}, ${VIEW.times_s[row].toFixed(2)} s`;
  draw();
}

function draw() {
  lamp.position.copy(eye.position);
  renderer.render(scene, eye);
}

function fit() {
  renderer.setSize(box.clientWidth, box.clientHeight);
  eye.aspect = box.clientWidth / Math.max(1, box.clientHeight);
  // A narrow screen sees as much from side to side.
  eye.fov = 2 * THREE.MathUtils.radToDeg(Math.atan(Math.tan(Math.PI / 8) / Math.min(1, eye.aspect)));
  eye.updateProjectionMatrix();
  controls.handleResize();
  draw();
}

let start = null;
function tick(now) {
  if (start) {
    const end_s = VIEW.times_s[VIEW.times_s.length - 1];
    const time_s = (start.time_s + (now - start.now) / 1000) % Math.max(end_s, 0.1);
    const next = VIEW.times_s.findIndex((t) => t >= time_s);
    if (next >= 0 && next !== Number(slider.value)) { slider.value = next; show(); }
  }
  eye.up.set(0, 0, 1); // the floor stays level while one turns
  controls.update();
  requestAnimationFrame(tick);
}

document.getElementById("play").addEventListener("click", (event) => {
  start = start ? null : { now: performance.now(), time_s: VIEW.times_s[Number(slider.value)] };
  event.target.textContent = start ? "❚❚" : "▶";
});
slider.addEventListener("input", () => { start = null; document.getElementById("play").textContent = "▶"; show(); });
controls.addEventListener("change", draw);
addEventListener("resize", fit);
const asked = VIEW.frames.findIndex((frame) => frame >= Number(location.hash.slice(1)));
slider.value = Math.max(0, asked);
stand();
fit();
show();
requestAnimationFrame(tick);
