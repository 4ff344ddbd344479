'use strict';
// What is shown of a frame and from where, controls, and where frames come from: all at once in a report, as they come in
// the live viewer.

// ---- showing a frame ---------------------------------------------------------------------------------------------

const view = { target: new THREE.Vector3(), beside: new THREE.Vector3(), finger: -1 };
const frames = [], most_frames = run.live ? 1800 : Infinity;
const unwelcome_motion = Boolean(window.matchMedia) && window.matchMedia('(prefers-reduced-motion: reduce)').matches;
let now = 0, playing = run.live || !unwelcome_motion, elapsed = 0, largest_force = 1e-6, largest_sum = model.force_N || 0.5;
let contacts = [];  // of the frame shown

let sharpening = null, drawn_as = '';
function sharpenSoon() {
  clearTimeout(sharpening);
  sharpening = setTimeout(() => { if (!playing) draw(2); }, 250);
}
/** The scene, and the pads below it; in software, once more and finer where it stays. */
function draw(fineness = 1) {
  const device = window.devicePixelRatio || 1, ratio = fineness * (detail.level > 0 ? Math.min(1, device) * detail.ratio : device);
  if (renderer.getPixelRatio() !== ratio) renderer.setPixelRatio(ratio);
  if (drawn_in_software && fineness === 1 && !playing) sharpenSoon();
  const { clientWidth: width, clientHeight: all_height } = by('viewport'), rows = padRows(width, all_height), height = all_height - rows.height;
  const as = [width, all_height, ratio, rows.height, rows.cells.length].join(), all = detail.level === 0 || as !== drawn_as;
  drawn_as = as;
  ++detail.turn;
  if (floors.length > 0 && (all || detail.turn % (3 * detail.turns) === 0)) castShadow(renderer, scene, middleOf(frames[now], -1));
  renderer.setScissorTest(false);
  if (all) renderer.setClearColor(air), renderer.clear();
  renderer.setScissorTest(true);
  const part = (x, y, w, h, what, from) => {
    renderer.setViewport(x, y, w, h);
    renderer.setScissor(x, y, w, h);
    renderer.render(what, from);
  };
  camera.aspect = width / Math.max(1, height);
  camera.updateProjectionMatrix();
  camera.updateMatrixWorld();
  showContacts(contacts, camera);
  part(0, rows.height, width, height, scene, camera);
  if (all || detail.turn % Math.min(3, detail.turns) === 0) showNames(frames[now], width, height);
  name_lines.draw(width, height, (what, from) => part(0, rows.height, width, height, what, from));
  if (frames.length > 0) drawPads(rows, width, frames[now], all, part);
}

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
  const before = frames[frames.length - 1];
  frame.steps_so_far = frame.steps + (before ? before.steps_so_far : 0);
  frames.push(frame);
  frame.fingers.forEach((f, k) => {
    f.converged_so_far = f.converged + (before ? before.fingers[k].converged_so_far : 0);
    const rest = model.fingers[k].rest;
    for (const q of Object.values(quantities)) {
      let peak = 0;
      for (let i = 0; i < f.pressure.length; ++i) peak = Math.max(peak, q.of(f, i, rest));
      q.peaks.push(peak);
      if (q === quantities.pressure) pad_scales[k].peaks.push(peak);
    }
    if (!model.force_N) largest_sum = Math.max(largest_sum, f.force);
    for (let i = 0; i < f.forces.length; i += 3)
      largest_force = Math.max(largest_force, Math.hypot(f.forces[i], f.forces[i + 1], f.forces[i + 2]));
  });
  if (run.live && frames.length % 15 === 1) fitScales();
  for (const plot of plots)
    plot.curves.forEach(curve => curve.values.push(plot.of(frame, curve)));
}

function showFinger(k, f) {
  const { group, edges, lines, move } = fingers[k], q = quantities[by('colour').value];
  const { rest, samples } = model.fingers[k], stretch = q === quantities.stretch;
  place(group, f.bone);
  edges.visible = by('mesh').checked;
  coat.scale.most.value = q.most, coat.scale.limited.value = Number(stretch);
  group.updateMatrixWorld();
  move(f.position);
  coat.put(k, group.matrixWorld, i => stretch && f.limited[i] ? 3 * q.most : q.of(f, i, rest));  // beyond twice the scale: at a limit
  // Forces: their sum, which ends at the centre of pressure; of one finger looked at alone, each sample's.
  const centre = centreOfPressure(f, samples), sum = new THREE.Vector3(), x = new THREE.Vector3();
  for (let i = 0; i < f.forces.length; i += 3) sum.add(x.fromArray(f.forces, i));
  arrows.hide(k);
  if (centre) {
    const place = new THREE.Vector3(...centre).applyMatrix4(group.matrixWorld);
    contacts.push({ at: place, force: sum });
    if (sum.length() > 1e-9) arrows.point(k, place, sum.clone().setLength(22 * Math.min(1, sum.length() / largest_sum)));
  }
  lines.visible = by('arrows').checked && view.finger === k;
  if (!lines.visible) return;
  const line = lines.geometry.attributes.position, length = 12 / largest_force;
  samples.forEach((node, s) => {
    x.fromArray(f.position, 3 * node).applyMatrix4(group.matrixWorld);
    line.array.set([x.x, x.y, x.z, x.x + length * f.forces[3 * s], x.y + length * f.forces[3 * s + 1],
                    x.z + length * f.forces[3 * s + 2]], 6 * s);
  });
  line.needsUpdate = true;
}

function showTouches(k, frame, t) {
  const { finger } = model.thimbles[k], { samples } = model.fingers[finger], f = frame.fingers[finger];
  const { points } = thimbles[k], at = points.geometry.attributes, x = new THREE.Vector3();
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
  contacts = [];
  frame.fingers.forEach((f, k) => showFinger(k, f));
  frame.objects.forEach((pose, k) => {
    place(objects[k], pose);
    if (objects[k].settle) objects[k].settle();
    if (objects[k].dent) objects[k].dent(pose);
    if (objects[k].give) objects[k].give(skinNear(objects[k], frame));
    objects[k].visible = by('objects').checked;
  });
  if (!ground && objects.length > 0 && !model.objects.some(object => object.kind === 'plane')) {
    ground = groundBelow(objects);
    scene.add(ground);
    floors.push(ground);
  }
  frame.hands.forEach((bones, k) => {
    hands[k].mesh.visible = by('hand').checked;
    if (by('hand').checked) hands[k].show(bones);
  });
  frame.thimbles.forEach((t, k) => {
    thimbles[k].show(t, fingers[model.thimbles[k].finger].group.matrixWorld);
    showTouches(k, frame, t);
  });
  thimble_rims.visible = by('platforms').checked && thimbles.length > 0;
  for (const { mesh, fit } of Object.values(thimble_bars)) mesh.visible = by('platforms').checked, fit();
  for (const mesh of arrows.meshes) mesh.visible = by('arrows').checked;
  document.body.dataset.time = frame.time.toFixed(6);  // for tests
  follow();
  draw();
  if (!isTurn(0)) return;
  by('when').max = frames.length - 1;
  by('when').value = now;
  by('time').textContent = frame.time.toFixed(2) + ' s';
  showNumbers(frame);
  drawPlots();
}
/** Where skin presses on something, in an object's frame [mm]. */
function skinNear(object, frame) {
  const points = [];
  object.updateMatrixWorld();
  const back = new THREE.Matrix4().getInverse(object.matrixWorld);
  frame.fingers.forEach((f, k) => model.fingers[k].samples.forEach((node, s) => {
    if (f.forces[3 * s] || f.forces[3 * s + 1] || f.forces[3 * s + 2])
      points.push(new THREE.Vector3().fromArray(f.position, 3 * node).applyMatrix4(fingers[k].group.matrixWorld).applyMatrix4(back));
  }));
  return points;
}

function showNumbers(frame) {
  by('fingers').innerHTML = '<tr><th></th><th>force N</th><th>area mm²</th><th>peak kPa</th>' +
    '<th title="share of the steps so far whose solve converged">converged %</th></tr>' +
    frame.fingers.map((f, k) => `<tr><td style="color:${palette[k % palette.length]}">${inHtml(model.fingers[k].name)}</td><td>` +
      `${f.force.toFixed(3)}</td><td>${(1e6 * f.area).toFixed(1)}</td><td>${Math.max(...f.pressure).toFixed(1)}</td><td>${
        frame.steps_so_far > 0 ? (100 * f.converged_so_far / frame.steps_so_far).toFixed(1) : ''}</td></tr>`)
      .join('');
  by('thimbles').innerHTML = frame.thimbles.map((t, k) => {
    const { joint_min: low, joint_max: high, finger } = model.thimbles[k];
    return `<div><span>${inHtml(model.fingers[finger].name)}</span>` + t.q.map((q, j) => {
      const share = (q - low[j]) / (high[j] - low[j]);
      return `<div class="bar" title="${(q * 180 / Math.PI).toFixed(1)} degrees"><i class="${
        share < 0.005 || share > 0.995 ? 'at-limit' : ''}" style="left:calc(${100 * Math.min(1, Math.max(0, share))}% - 1px)"></i></div>`;
    }).join('') + '</div>';
  }).join('');
}

// ---- camera and controls -----------------------------------------------------------------------------------------

function bonePlace(f) { return new THREE.Vector3(1e3 * f.bone[0], 1e3 * f.bone[1], 1e3 * f.bone[2]); }
function middleOf(frame, finger) {
  const chosen = finger < 0 ? frame.fingers : [frame.fingers[finger]], out = new THREE.Vector3();
  for (const f of chosen) out.add(bonePlace(f));
  return out.divideScalar(chosen.length).add(view.beside);
}
let following = false;
/** The camera keeps its place relative to what it looks at. */
function follow() {
  const target = middleOf(frames[now], view.finger);
  camera.position.add(target.clone().sub(view.target));
  controls.target.copy(target);
  view.target.copy(target);
  following = true;
  controls.update();
  following = false;
}
/** Looks at all fingers and their hand from the front right and above; at one, a little from below, where its pad touches. */
function aim(finger) {
  if (frames.length === 0) return;
  view.finger = finger;
  view.beside.set(0, 0, 0);
  const middle = middleOf(frames[now], finger), { clientWidth: width, clientHeight: height } = by('viewport');
  const narrow = Math.max(1, 1.5 * (height - padRows(width, height).height) / width);
  let reach = 30;
  if (finger < 0) for (const f of frames[now].fingers) reach = Math.max(reach, 30 + middle.distanceTo(bonePlace(f)));
  if (finger < 0) view.beside.set(-0.1 * reach, 0, 0.16 * reach);
  const from = finger < 0 ? new THREE.Vector3(0.70, -0.62, 0.30) : new THREE.Vector3(0.75, -0.85, -0.35);
  view.target.copy(middle).add(view.beside);
  camera.position.copy(view.target).addScaledVector(from.normalize(), (finger < 0 ? 4.4 : 2.7) * narrow * reach);
  show(now);
}
function zoom(by_factor) {
  camera.position.sub(controls.target).multiplyScalar(by_factor).add(controls.target);
  controls.update();
  draw();
}
function resize() {
  const box = by('viewport').getBoundingClientRect();
  renderer.setSize(box.width, box.height);
}
function legend() {
  const q = quantities[by('colour').value], g = by('scale').getContext('2d');
  by('legend-title').textContent = q.title;
  by('most').textContent = 'over ' + Number(q.most.toPrecision(4)) + ' ' + q.unit;
  for (let i = 0; i < 180; ++i) {
    g.fillStyle = 'rgb(' + skinColour(i / 179).map(c => Math.round(255 * c)).join(',') + ')';
    g.fillRect(i, 0, 1, 12);
  }
}

by('title').textContent = model.title;
document.title = model.title + ' - palpate';
by('about').textContent = run.about;
by('summary').textContent = run.summary;
by('scene').textContent = run.scene;
by('summary').parentElement.hidden = run.live;
by('thimbles-box').hidden = by('matched').hidden = model.thimbles.length === 0;
by('settings-box').hidden = by('restart').hidden = !run.live;
model.fingers.forEach((f, k) => by('camera').add(new Option(f.name, k)));
by('colour').onchange = () => { legend(); show(now); };
by('scale-end').onchange = () => {
  const kPa = Number(by('scale-end').value);
  pressure_fixed = kPa > 0 ? kPa : null;
  fitScales();
  legend();
  show(now);
};
by('camera').onchange = () => aim(Number(by('camera').value));
for (const id of ['arrows', 'hand', 'platforms', 'objects', 'touches', 'pads', 'felt', 'names', 'mesh']) by(id).onchange = () => show(now);

let tell = () => {};  // the live viewer's way to the simulation
function play(on) {
  playing = on;
  beginDetail(on, model.fingers.length);
  if (!on) show(now);
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
controls.addEventListener('change', () => { if (!following) draw(); });
window.addEventListener('resize', () => { resize(); show(now); });
resize();
if (!playing) by('play').textContent = 'play';

// ---- a report: all frames are here --------------------------------------------------------------------------------

let last = 0;
function tick(stamp) {
  const passed = Math.min(0.1, (stamp - last) / 1e3);
  if (playing) paceDetail(stamp - last);
  last = stamp;
  if (playing && frames.length > 1) {
    elapsed += passed * Number(by('speed').value);
    const from = frames[now].time;
    let next = now;
    while (next + 1 < frames.length && frames[next + 1].time - from <= elapsed) ++next;
    if (next !== now) {
      elapsed -= frames[next].time - from;
      show(next);
      if (next === frames.length - 1 && link.has('probe')) console.log('played to the end');  // for tests
    }
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
  beginDetail(playing, model.fingers.length);
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
let fresh = false;  // a frame has come that is to be shown
/** Shows the newest of the frames that have come, no oftener than they can be drawn. */
function showNewest(stamp) {
  if (playing && last > 0) paceDetail(stamp - last);
  last = stamp;
  if (fresh) show(frames.length - 1);
  fresh = false;
  requestAnimationFrame(showNewest);
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
      beginDetail(playing, model.fingers.length);
      aim(-1);
      requestAnimationFrame(showNewest);
      if (link.has('probe')) console.log('first picture drawn');  // for tests
    }
    else if (playing || now >= frames.length - 2) fresh = true;
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
if (link.has('scale')) { by('scale-end').value = link.get('scale'); by('scale-end').onchange(); }
if (link.has('touches')) { by('touches').checked = true; show(now); }
if (link.has('still')) play(false);
document.body.dataset.frames = frames.length;
document.body.dataset.ready = '1';

/** Counts the colours of the picture, the pixels of strong contact, and the names that are seen whole: for tests of what is
    drawn. */
function probe() {
  const w = renderer.domElement.width, h = renderer.domElement.height, pixels = new Uint8Array(4 * w * h), seen = new Set();
  const gl = renderer.getContext();
  gl.readPixels(0, 0, w, h, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
  let red = 0;
  for (let i = 0; i < pixels.length; i += 4) {
    seen.add((pixels[i] << 16) | (pixels[i + 1] << 8) | pixels[i + 2]);
    if (pixels[i] > 60 && pixels[i] > 1.5 * pixels[i + 1] && pixels[i] > 1.3 * pixels[i + 2]) ++red;
  }
  const viewport_box = by('viewport').getBoundingClientRect(), labels = [...document.querySelectorAll('.tag, .pad b')];
  const boxes = labels.map(label => label.getBoundingClientRect());
  const whole = labels.filter((label, k) => {
    const box = boxes[k], inside = box.width > 0 && box.left >= viewport_box.left && box.right <= viewport_box.right &&
      box.top >= viewport_box.top && box.bottom <= viewport_box.bottom;
    const clear = boxes.every((other, j) => j === k || other.width === 0 || box.right <= other.left || other.right <= box.left ||
      box.bottom <= other.top || other.bottom <= box.top);
    const parent = label.parentElement, fits = !parent.classList.contains('pad') ||
      (label.scrollWidth <= parent.clientWidth && parent.scrollHeight <= parent.clientHeight + 1);
    return inside && clear && fits;
  });
  const programs = renderer.info.programs.filter(program => program.diagnostics && !program.diagnostics.runnable);
  Object.assign(document.body.dataset, { colours: seen.size, red, names: whole.filter(label => label.className === 'tag').map(label => label.dataset.finger).join('|'),
    pads: whole.filter(label => label.className !== 'tag').map(label => label.textContent).join('|'),
    across: document.documentElement.scrollWidth - window.innerWidth });
  if (programs.length > 0) document.body.dataset.error = 'a shader does not compile';
}
