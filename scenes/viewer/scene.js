'use strict';
// The things of the scene in three dimensions, as the stage lists them. Lengths in millimetres.

/** Whether pixels are drawn without a graphics card: then edges are smoothed only where the picture stands still. */
const drawn_in_software = (() => {
  const gl = document.createElement('canvas').getContext('webgl'), about = gl && gl.getExtension('WEBGL_debug_renderer_info');
  return Boolean(about) && /swiftshader|llvmpipe|softpipe|software|basic render/i.test(gl.getParameter(about.UNMASKED_RENDERER_WEBGL));
})();
const renderer = new THREE.WebGLRenderer({ antialias: !drawn_in_software, preserveDrawingBuffer: true });
by('stage').appendChild(renderer.domElement);
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
/** An arrow of a force; point(to, way) lets it end at a place. */
function arrowOf() {
  const arrow = new THREE.Group(), material = new THREE.MeshLambertMaterial({ color: dark ? '#cfd8e3' : '#1a1f29' });
  const shaft = new THREE.Mesh(bar_shape, material);
  const head = new THREE.Mesh(new THREE.CylinderBufferGeometry(0, 2.2, 4.5, 12).translate(0, -2.25, 0).rotateX(Math.PI / 2), material);
  arrow.add(shaft, head);
  arrow.point = (to, way) => {
    const length = way.length(), along = way.clone().normalize(), size = Math.min(1, length / 9);
    head.position.copy(to);
    head.quaternion.setFromUnitVectors(z_axis, along);
    head.scale.setScalar(size);
    layBar(shaft, to.clone().sub(way), to.clone().addScaledVector(along, -4 * size), 0.9);
  };
  return arrow;
}

const fingers = stage.fingers.map(finger => {
  const skin = skinOf(finger);
  scene.add(skin.group);
  const shape = new THREE.BufferGeometry(), arrow = arrowOf();
  shape.setAttribute('position', new THREE.BufferAttribute(new Float32Array(6 * finger.samples.length), 3));
  const lines = new THREE.LineSegments(shape, new THREE.LineBasicMaterial({ color: '#b3261e', depthTest: false }));
  lines.frustumCulled = false;
  scene.add(lines, arrow);
  return { ...skin, lines, arrow };
});

const objects = stage.objects.map((object, k) => {
  const group = objectOf(object, k);
  scene.add(group);
  return group;
});
let ground = null;
const hands = stage.hands.map(hand => {
  const drawn = handOf(hand);
  scene.add(drawn.group);
  return drawn;
});
const thimbles = stage.thimbles.map(thimble => {
  const mechanism = mechanismOf(thimble);
  scene.add(mechanism.holder);
  // Samples that touch: the object and the platform, the object alone, the platform alone.
  const dots = new THREE.BufferGeometry(), count = stage.fingers[thimble.finger].samples.length;
  dots.setAttribute('position', new THREE.BufferAttribute(new Float32Array(3 * count), 3));
  dots.setAttribute('color', new THREE.BufferAttribute(new Float32Array(3 * count), 3));
  const points = new THREE.Points(dots, new THREE.PointsMaterial(
    { size: 7, sizeAttenuation: false, vertexColors: THREE.VertexColors, depthTest: false, transparent: true }));
  points.frustumCulled = false;
  scene.add(points);
  return { ...mechanism, points };
});
const touchColours = [[0, 0, 0], [0.85, 0.45, 0.05], [0.12, 0.44, 0.92], [0.1, 0.55, 0.2]];
