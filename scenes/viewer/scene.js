'use strict';
// The things of the scene in three dimensions, as the model lists them. Lengths in millimetres.

const renderer = new THREE.WebGLRenderer({ antialias: !drawn_in_software, preserveDrawingBuffer: true });
by('viewport').appendChild(renderer.domElement);
const scene = new THREE.Scene();
const camera = new THREE.PerspectiveCamera(32, 1, 1, 4000);
camera.up.set(0, 0, 1);
const controls = new THREE.OrbitControls(camera, renderer.domElement);
scene.add(new THREE.HemisphereLight('#ffffff', '#c9ced6', 0.85));
const sun = new THREE.DirectionalLight('#ffffff', 0.4);
sun.position.set(1, -1.2, 1.6);
scene.add(sun);

function place(object, pose) {
  object.position.set(1e3 * pose[0], 1e3 * pose[1], 1e3 * pose[2]);
  object.quaternion.set(pose[4], pose[5], pose[6], pose[3]);
}

const air = dark ? '#1b2028' : '#eef1f5';
renderer.setClearColor(air);
scene.background = new THREE.Color(air);
/** Arrows of forces: point(k, to, force) lets one end at a place. */
const arrows = (() => {
  const material = new THREE.MeshLambertMaterial({ color: dark ? '#cfd8e3' : '#1a1f29' }), count = model.fingers.length;
  const shafts = barsOf(material, count), heads = barsOf(material, count, new THREE.CylinderBufferGeometry(0, 1, 1, 12).rotateX(Math.PI / 2));
  const neck = new THREE.Vector3(), from = new THREE.Vector3(), meshes = [shafts.mesh, heads.mesh];
  function point(k, to, force) {
    const length = force.length(), size = Math.min(1, length / 9);
    neck.copy(to).addScaledVector(force, -4.5 * size / length);
    shafts.lay(k, from.copy(to).sub(force), neck, 0.9);
    heads.lay(k, neck, to, 2.2 * size);
  }
  return { meshes, point, hide: k => { shafts.hide(k); heads.hide(k); } };
})();
scene.add(...arrows.meshes);

const fingers = model.fingers.map(finger => {
  const skin = skinOf(finger);
  skin.group.remove(skin.mesh);  // its coat is drawn instead
  scene.add(skin.group);
  const shape = new THREE.BufferGeometry();
  shape.setAttribute('position', new THREE.BufferAttribute(new Float32Array(6 * finger.samples.length), 3));
  const lines = new THREE.LineSegments(shape, new THREE.LineBasicMaterial({ color: '#b3261e', depthTest: false }));
  lines.frustumCulled = false;
  scene.add(lines);
  return { ...skin, lines };
});

const coat = coatOf(fingers);
scene.add(coat.mesh);

const objects = model.objects.map((object, k) => {
  const group = objectOf(object, k);
  scene.add(group);
  return group;
});
let ground = null;
const floors = objects.filter((_, k) => model.objects[k].kind === 'plane');
const hands = model.hands.map(hand => {
  const drawn = handOf(hand);
  scene.add(drawn.mesh);
  return drawn;
});
for (const { mesh } of Object.values(thimble_bars)) scene.add(mesh);
scene.add(thimble_rims);
const thimbles = model.thimbles.map((thimble, k) => {
  // Samples that touch: the object and the platform, the object alone, the platform alone.
  const dots = new THREE.BufferGeometry(), count = model.fingers[thimble.finger].samples.length;
  dots.setAttribute('position', new THREE.BufferAttribute(new Float32Array(3 * count), 3));
  dots.setAttribute('color', new THREE.BufferAttribute(new Float32Array(3 * count), 3));
  const points = new THREE.Points(dots, new THREE.PointsMaterial(
    { size: 7, sizeAttenuation: false, vertexColors: THREE.VertexColors, depthTest: false, transparent: true }));
  points.frustumCulled = false;
  scene.add(points);
  return { ...mechanisms[k], points };
});
const touchColours = [[0, 0, 0], [0.85, 0.45, 0.05], [0.12, 0.44, 0.92], [0.1, 0.55, 0.2]];

// What stands on the floor, in its shadow.
casts(coat.mesh);
for (const { mesh } of hands) casts(mesh);
model.objects.forEach((object, k) => { if (object.kind !== 'plane') casts(objects[k].children[0]); });
for (const { mesh } of Object.values(thimble_bars)) casts(mesh);
