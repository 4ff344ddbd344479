'use strict';
// The scene in three dimensions, its controls, and where frames come from: all at once in a report, as they come in the
// live viewer. Lengths in millimetres.

// ---- the 3-D scene -----------------------------------------------------------------------------------------------

const renderer = new THREE.WebGLRenderer({ antialias: true, preserveDrawingBuffer: true });
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

/** A disk of a thimble, z towards the pad. */
function diskOf(thimble) {
  const disk = new THREE.Group(), r = 1e3 * thimble.radius;
  disk.add(new THREE.Mesh(new THREE.CircleGeometry(r, 48), new THREE.MeshLambertMaterial(
    { color: '#2f9e44', transparent: true, opacity: 0.16, side: THREE.DoubleSide, depthWrite: false })));
  const rim = new THREE.BufferGeometry().setFromPoints(Array.from({ length: 65 }, (_, k) =>
    new THREE.Vector3(r * Math.cos(k * Math.PI / 32), r * Math.sin(k * Math.PI / 32), 0)));
  disk.add(new THREE.Line(rim, new THREE.LineBasicMaterial({ color: '#1b7a33' })));
  return disk;
}

const dark = window.matchMedia && window.matchMedia('(prefers-color-scheme: dark)').matches;
const air = dark ? '#1b2028' : '#eef1f5';
renderer.setClearColor(air);
scene.background = new THREE.Color(air);
const tags = stage.fingers.map((finger, k) => nameTag(finger.name, palette[k % palette.length]));

const fingers = stage.fingers.map(finger => {
  const skin = skinOf(finger);
  scene.add(skin.group);
  const lines = new THREE.BufferGeometry();
  lines.setAttribute('position', new THREE.BufferAttribute(new Float32Array(6 * finger.samples.length), 3));
  const arrows = new THREE.LineSegments(lines, new THREE.LineBasicMaterial({ color: '#b3261e', depthTest: false }));
  arrows.frustumCulled = false;
  scene.add(arrows);
  return { ...skin, arrows };
});

const objects = stage.objects.map((object, k) => {
  const group = objectOf(object, k);
  scene.add(group);
  return group;
});
let ground = null;
const platforms = stage.thimbles.map(thimble => {
  const holder = new THREE.Group(), disk = diskOf(thimble);
  holder.add(disk);
  const links = thimble.links.map(count => {
    const shape = new THREE.BufferGeometry();
    shape.setAttribute('position', new THREE.BufferAttribute(new Float32Array(3 * count), 3));
    const line = new THREE.Line(shape, new THREE.LineBasicMaterial({ color: '#3d6b4a' }));
    line.frustumCulled = false;
    holder.add(line);
    return shape.attributes.position;
  });
  scene.add(holder);
  // Samples that touch: the object and the platform, the object alone, the platform alone.
  const dots = new THREE.BufferGeometry(), count = stage.fingers[thimble.finger].samples.length;
  dots.setAttribute('position', new THREE.BufferAttribute(new Float32Array(3 * count), 3));
  dots.setAttribute('color', new THREE.BufferAttribute(new Float32Array(3 * count), 3));
  const points = new THREE.Points(dots, new THREE.PointsMaterial(
    { size: 7, sizeAttenuation: false, vertexColors: THREE.VertexColors, depthTest: false, transparent: true }));
  points.frustumCulled = false;
  scene.add(points);
  return { holder, disk, links, points };
});
const touchColours = [[0, 0, 0], [0.85, 0.45, 0.05], [0.12, 0.44, 0.92], [0.1, 0.55, 0.2]];

// ---- insets: what the users' fingers undergo ------------------------------------------------------------------------

const insets = stage.thimbles.map((thimble, k) => {
  const inset = new THREE.Scene(), skin = skinOf(stage.fingers[thimble.finger]), disk = diskOf(thimble);
  inset.add(new THREE.HemisphereLight('#ffffff', '#c9ced6', 0.85), sun.clone(), skin.group, disk);
  inset.background = new THREE.Color(dark ? '#232a34' : '#fbfcfd');
  const label = document.createElement('div');
  label.className = 'felt';
  by('stage').append(label);
  return { scene: inset, skin, disk, label };
});
const insetCamera = new THREE.PerspectiveCamera(25, 1, 1, 400);
insetCamera.up.set(0, 0, 1);
insetCamera.position.set(66, -75, -39);
insetCamera.lookAt(0, 0, -2);

function showInset(k, t) {
  const { skin, disk } = insets[k];
  skin.show(t.felt.position, i => t.felt.pressure[i], value => skinColour(value / quantities.pressure.most));
  place(disk, t.pose);
}
/** Height of the row of insets at the bottom of the stage, labels included; 0 without them. */
function insetRow() {
  const side = Math.min(150, Math.floor(by('stage').clientWidth / Math.max(1, insets.length)) - 9);
  return by('felt').checked && insets.length > 0 ? { side, height: side + 46 } : { side, height: 0 };
}
/** The scene, and the insets below it. */
function draw() {
  const { clientWidth: width, clientHeight: height } = by('stage'), row = insetRow();
  renderer.setScissorTest(false);
  renderer.clear();
  renderer.setScissorTest(true);
  const part = (x, y, w, h, what, from) => {
    renderer.setViewport(x, y, w, h);
    renderer.setScissor(x, y, w, h);
    renderer.render(what, from);
  };
  camera.aspect = width / Math.max(1, height - row.height);
  camera.updateProjectionMatrix();
  part(0, row.height, width, height - row.height, scene, camera);
  fingers.forEach(({ group }, k) => tags[k](new THREE.Vector3(-4, 0, 9).applyMatrix4(group.matrixWorld), camera, width,
                                           height - row.height, by('names').checked && frames.length > 0));
  insets.forEach((inset, k) => {
    const x = 8 + k * (row.side + 8);
    inset.label.hidden = row.height === 0;
    Object.assign(inset.label.style, { left: x + 'px', bottom: (row.side + 10) + 'px', width: row.side + 'px' });
    if (row.height > 0) part(x, 8, row.side, row.side, inset.scene, insetCamera);
  });
}

// ---- showing a frame ---------------------------------------------------------------------------------------------

const frames = [], most_frames = run.live ? 1800 : Infinity;
let now = 0, playing = true, elapsed = 0, largest_force = 1e-6;

/** Takes a frame; a time before the last one's means that the run began anew. */
function addFrame(frame) {
  if (frames.length > 0 && frame.time < frames[frames.length - 1].time) {
    frames.length = 0;
    for (const plot of plots) plot.curves.forEach(curve => { curve.values.length = 0; });
    span = null;
  }
  if (frames.length >= most_frames) {
    frames.shift();
    for (const plot of plots) plot.curves.forEach(curve => curve.values.shift());
  }
  frames.push(frame);
  frame.fingers.forEach((f, k) => {
    const rest = stage.fingers[k].rest;
    for (const q of Object.values(quantities)) {
      let peak = 0;
      for (let i = 0; i < f.pressure.length; ++i) peak = Math.max(peak, q.of(f, i, rest));
      q.peaks.push(peak);
    }
    for (let i = 0; i < f.forces.length; i += 3)
      largest_force = Math.max(largest_force, Math.hypot(f.forces[i], f.forces[i + 1], f.forces[i + 2]));
  });
  if (run.live && frames.length % 15 === 1) fitScales();
  for (const plot of plots)
    plot.curves.forEach(curve => curve.values.push(plot.of(frame, curve)));
}

function showFinger(k, f) {
  const { group, edges, arrows } = fingers[k], q = quantities[by('colour').value], { rest } = stage.fingers[k];
  place(group, f.bone);
  edges.visible = by('mesh').checked;
  const stretch = q === quantities.stretch;
  // Beyond twice the scale: at a limit.
  fingers[k].show(f.position, i => stretch && f.limited[i] ? 3 * q.most : q.of(f, i, rest),
                  value => stretch && value > 2 * q.most ? limit_colour : skinColour(value / q.most));
  group.updateMatrixWorld();
  const line = arrows.geometry.attributes.position.array, scale = 12 / largest_force, x = new THREE.Vector3();
  stage.fingers[k].samples.forEach((node, s) => {
    x.fromArray(f.position, 3 * node).applyMatrix4(group.matrixWorld);
    line.set([x.x, x.y, x.z, x.x + scale * f.forces[3 * s], x.y + scale * f.forces[3 * s + 1],
              x.z + scale * f.forces[3 * s + 2]], 6 * s);
  });
  arrows.geometry.attributes.position.needsUpdate = true;
  arrows.visible = by('arrows').checked;
}

function showTouches(k, frame, t) {
  const { finger } = stage.thimbles[k], { samples } = stage.fingers[finger], f = frame.fingers[finger];
  const { points } = platforms[k], at = points.geometry.attributes, x = new THREE.Vector3();
  let shown = 0;
  samples.forEach((node, s) => {
    if (!t.felt.touches[s]) return;
    x.fromArray(f.position, 3 * node).applyMatrix4(fingers[finger].group.matrixWorld);
    at.position.array.set([x.x, x.y, x.z], 3 * shown);
    at.color.array.set(touchColours[t.felt.touches[s]], 3 * shown++);
  });
  at.position.needsUpdate = at.color.needsUpdate = true;
  points.geometry.setDrawRange(0, shown);
  points.visible = by('touches').checked;
}

function show(index) {
  if (frames.length === 0) return;
  now = Math.max(0, Math.min(frames.length - 1, index));
  const frame = frames[now];
  frame.fingers.forEach((f, k) => showFinger(k, f));
  if (!ground && stage.objects.length > 0 && !stage.objects.some(object => object.kind === 'plane')) {
    const all = new THREE.Group();
    frame.objects.forEach((pose, k) => { place(objects[k], pose); all.add(objects[k].clone()); });
    ground = groundBelow(all);
    scene.add(ground);
  }
  frame.objects.forEach((pose, k) => { place(objects[k], pose); objects[k].visible = by('objects').checked; });
  frame.thimbles.forEach((t, k) => {
    place(platforms[k].holder, frame.fingers[stage.thimbles[k].finger].bone);
    place(platforms[k].disk, t.pose);
    t.links.forEach((points, j) => {
      platforms[k].links[j].array.set(points);
      platforms[k].links[j].needsUpdate = true;
    });
    platforms[k].holder.visible = by('platforms').checked;
    showTouches(k, frame, t);
    showInset(k, t);
    const wanted = frame.fingers[stage.thimbles[k].finger].force;
    insets[k].label.textContent =
      `${stage.fingers[stage.thimbles[k].finger].name}\nfeels ${t.felt.force.toFixed(2)} of ${wanted.toFixed(2)} N`;
  });
  by('when').max = frames.length - 1;
  by('when').value = now;
  by('time').textContent = frame.time.toFixed(2) + ' s';
  document.body.dataset.time = frame.time.toFixed(6);  // for tests
  showNumbers(frame);
  follow();
  draw();
  drawPlots();
}

function showNumbers(frame) {
  by('fingers').innerHTML = '<tr><th></th><th>force N</th><th>area mm²</th><th>peak kPa</th></tr>' +
    frame.fingers.map((f, k) => `<tr><td style="color:${palette[k % palette.length]}">${stage.fingers[k].name}</td><td>` +
      `${f.force.toFixed(3)}</td><td>${(1e6 * f.area).toFixed(1)}</td><td>${Math.max(...f.pressure).toFixed(1)}</td></tr>`)
      .join('');
  by('thimbles').innerHTML = frame.thimbles.map((t, k) => {
    const { joint_min: low, joint_max: high, finger } = stage.thimbles[k];
    return `<div><span>${stage.fingers[finger].name}</span>` + t.q.map((q, j) => {
      const share = (q - low[j]) / (high[j] - low[j]);
      return `<div class="bar" title="${(q * 180 / Math.PI).toFixed(1)} degrees"><i class="${
        share < 0.005 || share > 0.995 ? 'at-limit' : ''}" style="left:calc(${100 * Math.min(1, Math.max(0, share))}% - 1px)"></i></div>`;
    }).join('') + '</div>';
  }).join('');
}

// ---- camera and controls -----------------------------------------------------------------------------------------

const view = { target: new THREE.Vector3(), finger: -1 };
function middleOf(frame, finger) {
  const chosen = finger < 0 ? frame.fingers : [frame.fingers[finger]], out = new THREE.Vector3();
  for (const f of chosen) out.add(new THREE.Vector3(1e3 * f.bone[0], 1e3 * f.bone[1], 1e3 * f.bone[2]));
  return out.divideScalar(chosen.length);
}
/** The camera keeps its place relative to what it looks at. */
function follow() {
  const target = middleOf(frames[now], view.finger);
  camera.position.add(target.clone().sub(view.target));
  controls.target.copy(target);
  view.target.copy(target);
  controls.update();
}
function aim(finger) {
  if (frames.length === 0) return;
  view.finger = finger;
  const target = middleOf(frames[now], finger);
  let reach = 30;
  for (const f of frames[now].fingers)
    if (finger < 0) reach = Math.max(reach, 26 + target.distanceTo(new THREE.Vector3(1e3 * f.bone[0], 1e3 * f.bone[1], 1e3 * f.bone[2])));
  // From the front right and a little below, where pads touch; planes are glass.
  camera.position.copy(target).add(new THREE.Vector3(0.75, -0.85, -0.35).normalize().multiplyScalar(2.7 * reach));
  view.target.copy(target);
  show(now);
}
function zoom(by_factor) {
  camera.position.sub(controls.target).multiplyScalar(by_factor).add(controls.target);
  controls.update();
  draw();
}
function resize() {
  const box = by('stage').getBoundingClientRect();
  renderer.setPixelRatio(window.devicePixelRatio || 1);
  renderer.setSize(box.width, box.height);
}
function legend() {
  const q = quantities[by('colour').value], g = by('scale').getContext('2d');
  by('legend-title').textContent = q.title;
  by('most').textContent = 'over ' + Number(q.most.toPrecision(2)) + ' ' + q.unit;
  for (let i = 0; i < 180; ++i) {
    g.fillStyle = 'rgb(' + skinColour(i / 179).map(c => Math.round(255 * c)).join(',') + ')';
    g.fillRect(i, 0, 1, 12);
  }
}

by('title').textContent = stage.title;
document.title = stage.title + ' - palpate';
by('about').textContent = run.about;
by('summary').textContent = run.summary;
by('scene').textContent = run.scene;
by('summary').parentElement.hidden = run.live;
by('thimbles-box').hidden = by('matched').hidden = stage.thimbles.length === 0;
by('settings-box').hidden = by('restart').hidden = !run.live;
stage.fingers.forEach((f, k) => by('camera').add(new Option(f.name, k)));
by('colour').onchange = () => { legend(); show(now); };
by('camera').onchange = () => aim(Number(by('camera').value));
for (const id of ['arrows', 'platforms', 'objects', 'touches', 'felt', 'names', 'mesh']) by(id).onchange = () => show(now);

let tell = () => {};  // the live viewer's way to the simulation
function play(on) {
  playing = on;
  by('play').textContent = on ? 'pause' : 'play';
  tell({ pause: !on });
}
by('play').onclick = () => play(!playing);
by('back').onclick = () => { play(false); show(now - 1); };
by('forth').onclick = () => {
  play(false);
  if (run.live && now === frames.length - 1) tell({ step: true });
  else show(now + 1);
};
by('rearm').onclick = () => tell({ rearm: true });
by('restart').onclick = () => tell({ restart: true });
by('speed').onchange = () => tell({ speed: Number(by('speed').value) });
by('when').oninput = () => { play(false); show(Number(by('when').value)); };
controls.addEventListener('change', draw);
window.addEventListener('resize', () => { resize(); show(now); });
resize();

// ---- a report: all frames are here --------------------------------------------------------------------------------

let last = 0;
function tick(stamp) {
  const passed = Math.min(0.1, (stamp - last) / 1e3);
  last = stamp;
  if (playing && frames.length > 1) {
    elapsed += passed * Number(by('speed').value);
    const from = frames[now].time;
    let next = now;
    while (next + 1 < frames.length && frames[next + 1].time - from <= elapsed) ++next;
    if (next !== now) { elapsed -= frames[next].time - from; show(next); }
    if (now === frames.length - 1 && elapsed > 1) { elapsed = 0; show(0); }
  }
  requestAnimationFrame(tick);
}
function startReport() {
  const bytes = bytesOf(run.frames), view = new DataView(bytes.buffer);
  for (let at = 0; at < bytes.length;) {
    const frame = readFrame(view, at);
    addFrame(frame);
    at = frame.end;
  }
  fitScales();
  legend();
  aim(-1);
  requestAnimationFrame(tick);
}

// ---- live: frames come over a WebSocket -----------------------------------------------------------------------------

function settingRows() {
  for (const setting of run.settings) {
    const row = document.createElement('div'), value = document.createElement('b');
    const input = document.createElement(setting.choices ? 'select' : 'input');
    row.className = 'setting';
    if (setting.choices) {
      for (const choice of setting.choices) input.add(new Option(choice));
      input.value = setting.value;
      input.dataset.setting = setting.label;
      input.onchange = () => tell({ set: setting.keys.map(key => key + '=' + input.value) });
      row.append(setting.label, input);
      by('settings').append(row);
      continue;
    }
    Object.assign(input, { type: 'range', min: setting.min, max: setting.max, step: setting.step, value: setting.value });
    input.dataset.setting = setting.label;
    value.textContent = setting.value;
    input.oninput = () => { value.textContent = input.value; };
    input.onchange = () => tell({ set: setting.keys.map(key => key + '=' + input.value) });
    row.append(setting.label, input, value);
    by('settings').append(row);
  }
}
function startLive() {
  const socket = new WebSocket('ws://' + location.host + '/frames' + location.search);  // with its token
  let first = true;
  socket.binaryType = 'arraybuffer';
  tell = message => socket.readyState === 1 && socket.send(JSON.stringify(message));
  socket.onmessage = event => {
    if (typeof event.data === 'string') {
      const message = JSON.parse(event.data);
      if (message.reload) location.reload();
      if ('error' in message) by('failure').textContent = message.error;
      if ('pace' in message) {
        by('about').textContent = `live: ${message.preset} · ${message.pace.toFixed(2)} x real time`;
        by('about').title = message.holds_time ? 'the most accurate preset whose steps keep up with real time' : 'the preset of the scene';
        if (link.has('probe')) console.log('pace shown: ' + by('about').textContent);  // for tests
      }
      if ('silent' in message) {
        by('silent').hidden = message.silent === '';
        by('silent').textContent = `no hand is seen; led to rest: ${message.silent}`;
      }
      if ('faults' in message) {
        by('faults').hidden = message.faults === '';
        by('faults').firstElementChild.textContent = `fault: ${message.faults}; mend its cause, then`;
      }
      return;
    }
    const most = Object.values(quantities).map(q => q.most).join();
    addFrame(readFrame(new DataView(event.data), 0));
    document.body.dataset.frames = frames.length;
    if (Object.values(quantities).map(q => q.most).join() !== most) legend();
    if (first) {
      first = false;
      fitScales();
      legend();
      aim(-1);
      if (link.has('probe')) console.log('first picture drawn');  // for tests
    }
    else if (playing || now >= frames.length - 2) show(frames.length - 1);
  };
  socket.onclose = () => { by('failure').textContent = 'The simulation has ended.'; };
  settingRows();
}

// A link such as report.html#t=0.4&still=1 opens at a time; tests use it, too.
const link = new URLSearchParams(location.hash.slice(1));
if (run.live) startLive();
else startReport();
if (link.has('t')) show(frames.findIndex(f => f.time >= Number(link.get('t')) - 1e-6));
if (link.has('colour')) { by('colour').value = link.get('colour'); legend(); show(now); }
if (link.has('finger')) { by('camera').value = link.get('finger'); aim(Number(link.get('finger'))); }
if (link.has('touches')) { by('touches').checked = true; show(now); }
if (link.has('still')) play(false);
if (link.has('probe') && frames.length > 0) probe();
document.body.dataset.frames = frames.length;
document.body.dataset.ready = '1';

/** Counts the colours of the picture, and the pixels of strong contact: for tests of what is drawn. */
function probe() {
  const w = renderer.domElement.width, h = renderer.domElement.height, pixels = new Uint8Array(4 * w * h), seen = new Set();
  const gl = renderer.getContext();
  gl.readPixels(0, 0, w, h, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
  let red = 0;
  for (let i = 0; i < pixels.length; i += 4) {
    seen.add((pixels[i] << 16) | (pixels[i + 1] << 8) | pixels[i + 2]);
    if (pixels[i] > 60 && pixels[i] > 1.5 * pixels[i + 1] && pixels[i] > 1.3 * pixels[i + 2]) ++red;
  }
  document.body.dataset.colours = seen.size;
  document.body.dataset.red = red;
}
