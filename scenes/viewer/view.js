'use strict';
// Draws a run: a stage (fingers, objects, thimbles) and its frames, in the format of stage.h: all at once in a report, as
// they come in the live viewer. Lengths in metres there, in millimetres here.
window.addEventListener('error', event => { document.body.dataset.error = event.message; });

const by = id => document.getElementById(id), run = JSON.parse(by('data').textContent), stage = run.stage;
for (const finger of stage.fingers) finger.rest = finger.rest.map(x => 1e3 * x);
const palette = ['#1f6feb', '#d9730d', '#2f9e44', '#c2255c', '#7048e8', '#0c8599', '#a61e4d', '#5c940d', '#862e9c', '#495057'];

// ---- frames ------------------------------------------------------------------------------------------------------

function bytesOf(text) {
  const raw = atob(text), out = new Uint8Array(raw.length);
  for (let i = 0; i < raw.length; ++i) out[i] = raw.charCodeAt(i);
  return out;
}

/** One frame as plain arrays; the reader follows append_frame() line by line. */
function readFrame(view, at) {
  let p = at;
  const f32 = () => { p += 4; return view.getFloat32(p - 4, true); };
  const i16 = () => { p += 2; return view.getInt16(p - 2, true); };
  const pose = () => { const v = []; for (let i = 0; i < 7; ++i) v.push(f32()); return v; };
  const frame = { time: f32(), step_us: f32(), fingers: [], objects: [], thimbles: [] };
  for (const finger of stage.fingers) {
    const n = finger.rest.length / 3;
    const f = { bone: pose(), force: f32(), area: f32(), position: new Float32Array(3 * n), pressure: new Float32Array(n),
      stretch: new Float32Array(n), limited: new Uint8Array(n), forces: new Float32Array(3 * finger.samples.length) };
    for (let i = 0; i < n; ++i) {
      for (let d = 0; d < 3; ++d) f.position[3 * i + d] = 2e-3 * i16();
      p += 2; f.pressure[i] = 0.01 * view.getUint16(p - 2, true);
      f.stretch[i] = view.getUint8(p++);
      f.limited[i] = view.getUint8(p++);
    }
    for (let i = 0; i < f.forces.length; ++i) f.forces[i] = 2e-4 * i16();
    frame.fingers.push(f);
  }
  for (let i = 0; i < stage.objects.length; ++i) frame.objects.push(pose());
  for (const thimble of stage.thimbles) {
    const t = { pose: pose(), q: [] };
    for (let k = 0; k < thimble.joint_min.length; ++k) t.q.push(f32());
    t.rms = f32();
    p += 4; t.contact = view.getUint32(p - 4, true) !== 0;
    t.links = thimble.links.map(count => Float32Array.from({ length: 3 * count }, () => 1e-2 * i16()));
    frame.thimbles.push(t);
  }
  frame.end = p;
  return frame;
}

// ---- colours -----------------------------------------------------------------------------------------------------

const quantities = {
  pressure: { title: 'contact pressure', unit: 'kPa', least: 1, of: (f, i) => f.pressure[i] },
  stretch: { title: 'stretch: departure from 1 (at a limit: blue)', unit: '%', least: 5, of: (f, i) => f.stretch[i] },
  displacement: { title: 'displacement from rest', unit: 'mm', least: 0.1, of: (f, i, rest) =>
    Math.hypot(f.position[3 * i] - rest[3 * i], f.position[3 * i + 1] - rest[3 * i + 1],
               f.position[3 * i + 2] - rest[3 * i + 2]) },
};
for (const q of Object.values(quantities)) q.most = q.least;
/** From skin to deep red. */
function skinColour(t) {
  t = Math.min(1, Math.max(0, t));
  return [(236 + t * (150 - 236)) / 255, (196 + t * (12 - 196)) / 255, (172 + t * (38 - 172)) / 255];
}

// ---- the 3-D scene -----------------------------------------------------------------------------------------------

const renderer = new THREE.WebGLRenderer({ antialias: true, preserveDrawingBuffer: true });
by('stage').appendChild(renderer.domElement);
const scene = new THREE.Scene();
scene.background = new THREE.Color('#eef1f5');
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

const fingers = stage.fingers.map(finger => {
  const geometry = new THREE.BufferGeometry(), n = finger.rest.length / 3;
  geometry.setAttribute('position', new THREE.BufferAttribute(new Float32Array(finger.rest), 3));
  geometry.setAttribute('color', new THREE.BufferAttribute(new Float32Array(3 * n), 3));
  geometry.setIndex(finger.triangles);
  const material = new THREE.MeshLambertMaterial({ vertexColors: THREE.VertexColors, side: THREE.DoubleSide });
  const group = new THREE.Group(), mesh = new THREE.Mesh(geometry, material);
  const edges = new THREE.Mesh(geometry, new THREE.MeshBasicMaterial(
    { color: '#000', wireframe: true, transparent: true, opacity: 0.08 }));
  mesh.frustumCulled = edges.frustumCulled = false;
  group.add(mesh, edges);
  scene.add(group);
  const lines = new THREE.BufferGeometry();
  lines.setAttribute('position', new THREE.BufferAttribute(new Float32Array(6 * finger.samples.length), 3));
  const arrows = new THREE.LineSegments(lines, new THREE.LineBasicMaterial({ color: '#b3261e', depthTest: false }));
  arrows.frustumCulled = false;
  scene.add(arrows);
  return { group, geometry, arrows };
});

function geometryOf(object) {
  const s = object.size.map(x => 1e3 * x);
  if (object.kind === 'plane') return new THREE.PlaneGeometry(240, 240);
  if (object.kind === 'box') return new THREE.BoxGeometry(2 * s[0], 2 * s[1], 2 * s[2]);
  if (object.kind === 'sphere') return new THREE.SphereGeometry(s[0], 48, 32);
  if (object.kind === 'mesh') {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute('position', new THREE.BufferAttribute(new Float32Array(object.vertices.map(x => 1e3 * x)), 3));
    geometry.setIndex(object.triangles);
    geometry.computeVertexNormals();
    return geometry;
  }
  const middle = new THREE.CylinderGeometry(s[0], s[0], 2 * s[1], 48).rotateX(Math.PI / 2);
  if (object.kind === 'capsule')
    for (const side of [-1, 1]) middle.merge(new THREE.SphereGeometry(s[0], 48, 24).translate(0, 0, side * s[1]));
  return middle;
}
const objects = stage.objects.map(object => {
  const plane = object.kind === 'plane';
  const mesh = new THREE.Mesh(geometryOf(object), new THREE.MeshLambertMaterial(
    { color: plane ? '#dfe7ee' : '#7fb0d8', transparent: true, opacity: plane ? 0.25 : 0.45, side: THREE.DoubleSide,
      depthWrite: false }));
  scene.add(mesh);
  return mesh;
});
const platforms = stage.thimbles.map(thimble => {
  const holder = new THREE.Group(), disk = new THREE.Group(), r = 1e3 * thimble.radius;
  disk.add(new THREE.Mesh(new THREE.CircleGeometry(r, 48), new THREE.MeshLambertMaterial(
    { color: '#2f9e44', transparent: true, opacity: 0.16, side: THREE.DoubleSide, depthWrite: false })));
  const rim = new THREE.BufferGeometry().setFromPoints(Array.from({ length: 65 }, (_, k) =>
    new THREE.Vector3(r * Math.cos(k * Math.PI / 32), r * Math.sin(k * Math.PI / 32), 0)));
  disk.add(new THREE.Line(rim, new THREE.LineBasicMaterial({ color: '#1b7a33' })));
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
  return { holder, disk, links };
});

// ---- showing a frame ---------------------------------------------------------------------------------------------

const frames = [], most_frames = run.live ? 1800 : Infinity;
let now = 0, playing = true, elapsed = 0, largest_force = 1e-6;

/** Takes a frame; a time before the last one's means that the run began anew. */
function addFrame(frame) {
  if (frames.length > 0 && frame.time < frames[frames.length - 1].time) {
    frames.length = 0;
    for (const plot of plots) plot.curves.forEach(curve => { curve.length = 0; });
  }
  if (frames.length >= most_frames) {
    frames.shift();
    for (const plot of plots) plot.curves.forEach(curve => curve.shift());
  }
  frames.push(frame);
  frame.fingers.forEach((f, k) => {
    const rest = stage.fingers[k].rest;
    for (const q of Object.values(quantities))
      for (let i = 0; i < f.pressure.length; ++i) q.most = Math.max(q.most, q.of(f, i, rest));
    for (let i = 0; i < f.forces.length; i += 3)
      largest_force = Math.max(largest_force, Math.hypot(f.forces[i], f.forces[i + 1], f.forces[i + 2]));
  });
  for (const plot of plots)
    plot.curves.forEach((curve, k) => {
      const value = plot.of(frame, k);
      curve.push(value);
      plot.most = Math.max(plot.most, value);
    });
}

function showFinger(k, f) {
  const { group, geometry, arrows } = fingers[k], q = quantities[by('colour').value], rest = stage.fingers[k].rest;
  place(group, f.bone);
  geometry.attributes.position.array.set(f.position);
  geometry.attributes.position.needsUpdate = true;
  const colours = geometry.attributes.color.array;
  for (let i = 0; i < f.pressure.length; ++i) {
    const limited = q === quantities.stretch && f.limited[i];
    colours.set(limited ? [0.12, 0.3, 0.85] : skinColour(q.of(f, i, rest) / q.most), 3 * i);
  }
  geometry.attributes.color.needsUpdate = true;
  geometry.computeVertexNormals();
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

function show(index) {
  if (frames.length === 0) return;
  now = Math.max(0, Math.min(frames.length - 1, index));
  const frame = frames[now];
  frame.fingers.forEach((f, k) => showFinger(k, f));
  frame.objects.forEach((pose, k) => { place(objects[k], pose); objects[k].visible = by('objects').checked; });
  frame.thimbles.forEach((t, k) => {
    place(platforms[k].holder, frame.fingers[stage.thimbles[k].finger].bone);
    place(platforms[k].disk, t.pose);
    t.links.forEach((points, j) => {
      platforms[k].links[j].array.set(points);
      platforms[k].links[j].needsUpdate = true;
    });
    platforms[k].holder.visible = by('platforms').checked;
  });
  by('when').max = frames.length - 1;
  by('when').value = now;
  by('time').textContent = frame.time.toFixed(2) + ' s';
  showNumbers(frame);
  follow();
  renderer.render(scene, camera);
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

// ---- plots -------------------------------------------------------------------------------------------------------

const curvesFor = list => list.map(() => []);
const plots = [
  { title: 'contact force [N]', curves: curvesFor(stage.fingers), of: (f, k) => f.fingers[k].force },
  { title: 'contact area [mm²]', curves: curvesFor(stage.fingers), of: (f, k) => 1e6 * f.fingers[k].area },
  { title: 'matching residual [mm]', curves: curvesFor(stage.thimbles), of: (f, k) => 1e3 * f.thimbles[k].rms,
    colours: stage.thimbles.map(t => palette[t.finger % palette.length]) },
  { title: 'longest step [µs] (line: the time step)', curves: [[]], of: f => f.step_us, colours: ['#495057'],
    line: 1e6 * stage.dt },
].filter(plot => plot.curves.length > 0);
for (const plot of plots) {
  plot.canvas = document.createElement('canvas');
  plot.canvas.className = 'plot';
  by('plots').appendChild(plot.canvas);
  plot.most = 1e-9;
}

function drawPlots() {
  const t0 = frames[0].time, t1 = Math.max(t0 + 1e-6, frames[frames.length - 1].time);
  for (const plot of plots) {
    const c = plot.canvas, ratio = window.devicePixelRatio || 1, w = c.clientWidth, h = c.clientHeight;
    c.width = w * ratio, c.height = h * ratio;
    const g = c.getContext('2d');
    g.scale(ratio, ratio);
    const x = t => 44 + (w - 52) * (t - t0) / (t1 - t0), y = v => h - 16 - (h - 34) * v / plot.most;
    g.font = '11px system-ui, sans-serif';
    g.fillStyle = '#1c2430';
    g.fillText(plot.title, 44, 11);
    g.fillStyle = '#5b6675';
    g.textAlign = 'right';
    if (plot.most > 1e-6) g.fillText(plot.most.toPrecision(3), 40, y(plot.most) + 4);
    g.fillText('0', 40, y(0) + 4);
    g.fillText(t1.toFixed(2) + ' s', w - 8, h - 3);
    g.strokeStyle = '#d5dbe3';
    g.strokeRect(44, y(plot.most), w - 52, y(0) - y(plot.most));
    if (plot.line <= plot.most) {
      g.strokeStyle = '#c62828';
      g.setLineDash([4, 3]);
      g.beginPath(); g.moveTo(44, y(plot.line)); g.lineTo(w - 8, y(plot.line)); g.stroke();
      g.setLineDash([]);
    }
    plot.curves.forEach((curve, k) => {
      g.strokeStyle = plot.colours ? plot.colours[k] : palette[k % palette.length];
      g.beginPath();
      curve.forEach((v, i) => i ? g.lineTo(x(frames[i].time), y(v)) : g.moveTo(x(frames[i].time), y(v)));
      g.stroke();
    });
    g.strokeStyle = '#1c2430';
    g.beginPath(); g.moveTo(x(frames[now].time), y(plot.most)); g.lineTo(x(frames[now].time), y(0)); g.stroke();
  }
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
function resize() {
  const box = by('stage').getBoundingClientRect();
  renderer.setPixelRatio(window.devicePixelRatio || 1);
  renderer.setSize(box.width, box.height);
  camera.aspect = box.width / Math.max(1, box.height);
  camera.updateProjectionMatrix();
}
function legend() {
  const q = quantities[by('colour').value], g = by('scale').getContext('2d');
  by('legend-title').textContent = q.title;
  by('most').textContent = q.most.toPrecision(3) + ' ' + q.unit;
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
by('thimbles-box').hidden = stage.thimbles.length === 0;
by('settings-box').hidden = by('restart').hidden = !run.live;
stage.fingers.forEach((f, k) => by('camera').add(new Option(f.name, k)));
by('colour').onchange = () => { legend(); show(now); };
by('camera').onchange = () => aim(Number(by('camera').value));
for (const id of ['arrows', 'platforms', 'objects']) by(id).onchange = () => show(now);

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
controls.addEventListener('change', () => renderer.render(scene, camera));
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
  legend();
  aim(-1);
  requestAnimationFrame(tick);
}

// ---- live: frames come over a WebSocket -----------------------------------------------------------------------------

function settingRows() {
  for (const setting of run.settings) {
    const row = document.createElement('div'), input = document.createElement('input'), value = document.createElement('b');
    Object.assign(input, { type: 'range', min: setting.min, max: setting.max, step: setting.step, value: setting.value });
    input.dataset.setting = setting.label;
    value.textContent = setting.value;
    input.oninput = () => { value.textContent = input.value; };
    input.onchange = () => tell({ set: setting.keys.map(key => key + '=' + input.value) });
    row.className = 'setting';
    row.append(setting.label, input, value);
    by('settings').append(row);
  }
}
function startLive() {
  const socket = new WebSocket('ws://' + location.host + '/frames');
  let first = true;
  socket.binaryType = 'arraybuffer';
  tell = message => socket.readyState === 1 && socket.send(JSON.stringify(message));
  socket.onmessage = event => {
    if (typeof event.data === 'string') {
      const message = JSON.parse(event.data);
      if (message.reload) location.reload();
      if ('error' in message) by('failure').textContent = message.error;
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
    if (first) { first = false; legend(); aim(-1); }
    else if (playing || now >= frames.length - 2) show(frames.length - 1);
  };
  socket.onclose = () => { by('failure').textContent = 'The simulation has ended.'; };
  settingRows();
}

if (run.live) startLive();
else startReport();

// A link such as report.html#t=0.4&still=1 opens at a time; tests use it, too.
const link = new URLSearchParams(location.hash.slice(1));
if (link.has('t')) show(frames.findIndex(f => f.time >= Number(link.get('t')) - 1e-6));
if (link.has('colour')) { by('colour').value = link.get('colour'); legend(); show(now); }
if (link.has('finger')) { by('camera').value = link.get('finger'); aim(Number(link.get('finger'))); }
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
