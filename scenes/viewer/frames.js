'use strict';
// A run: its model (fingers, objects, thimbles), its frames in the format of page_model.h, and how they are coloured. Lengths in
// metres there, in millimetres here.
window.addEventListener('error', event => { document.body.dataset.error = event.message; });

const dark = Boolean(window.matchMedia) && window.matchMedia('(prefers-color-scheme: dark)').matches;
const by = id => document.getElementById(id), run = JSON.parse(by('data').textContent), model = run.model;
const inHtml = text => text.replace(/[&<>"]/g, c => `&#${c.charCodeAt(0)};`);
/** A name as it is shown: its ends, where it is long. */
const shownName = name => { const all = Array.from(name); return all.length > 22 ? all.slice(0, 12).join('') + '…' + all.slice(-8).join('') : name; };
for (const finger of model.fingers) finger.name = shownName(finger.name);
for (const finger of model.fingers) finger.rest = finger.rest.map(x => 1e3 * x);
const hand_bone_count = 16;
const palette = dark  // of fingers
  ? ['#6ea8fe', '#f0a04b', '#5fcf80', '#f783ac', '#b197fc', '#4dd0e1', '#e599f7', '#c0e070', '#ffd43b', '#ced4da']
  : ['#1f6feb', '#c05f00', '#2b8a3e', '#c2255c', '#7048e8', '#0c7a8a', '#a61e4d', '#4c7a0c', '#862e9c', '#495057'];

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
  const frame = { time: f32(), step_us: f32(), steps: f32(), fingers: [], objects: [], thimbles: [] };
  const converged = model.fingers.map(() => f32());
  for (const [row, finger] of model.fingers.entries()) {
    const n = finger.rest.length / 3;
    const f = { bone: pose(), force: f32(), area: f32() }, pressure_unit = 1e-3 * f32(), force_unit = f32();
    f.converged = converged[row];
    Object.assign(f, { position: new Float32Array(3 * n), pressure: new Float32Array(n),
      stretch: new Float32Array(n), limited: new Uint8Array(n), forces: new Float32Array(3 * finger.samples.length) });
    for (let i = 0; i < n; ++i) {
      for (let d = 0; d < 3; ++d) f.position[3 * i + d] = 2e-3 * i16();
      p += 2; f.pressure[i] = pressure_unit * view.getUint16(p - 2, true);
      f.stretch[i] = view.getUint8(p++);
      f.limited[i] = view.getUint8(p++);
    }
    for (let i = 0; i < f.forces.length; ++i) f.forces[i] = force_unit * i16();
    p += 2;
    f.outline = Float32Array.from({ length: 3 * view.getUint16(p - 2, true) }, () => 2e-3 * i16());
    frame.fingers.push(f);
  }
  for (const object of model.objects) {
    const at = pose();
    frame.objects.push(at);
    if (object.kind !== 'soft') continue;
    const n = object.vertices.length / 3, unit = 1e-3 * f32();
    at.position = new Float32Array(3 * n), at.pressure = new Float32Array(n);
    for (let i = 0; i < n; ++i) {
      for (let d = 0; d < 3; ++d) at.position[3 * i + d] = 1e3 * f32();
      p += 2; at.pressure[i] = unit * view.getUint16(p - 2, true);
    }
  }
  for (const thimble of model.thimbles) {
    const t = { pose: pose(), q: [] };
    for (let k = 0; k < thimble.joint_min.length; ++k) t.q.push(f32());
    t.rms = f32();
    p += 4; t.contact = view.getUint32(p - 4, true) !== 0;
    t.links = thimble.links.map(count => Float32Array.from({ length: 3 * count }, () => 1e-2 * i16()));
    const { rest, samples } = model.fingers[thimble.finger], n = rest.length / 3;
    const force = f32(), unit = 1e-3 * f32();
    t.felt = { force, position: new Float32Array(3 * n), pressure: new Float32Array(n), touches: [] };
    for (let i = 0; i < n; ++i) {
      for (let d = 0; d < 3; ++d) t.felt.position[3 * i + d] = 2e-3 * i16();
      p += 2; t.felt.pressure[i] = unit * view.getUint16(p - 2, true);
    }
    for (let i = 0; i < samples.length; ++i) t.felt.touches.push(view.getUint8(p++));
    frame.thimbles.push(t);
  }
  frame.hands = model.hands.map(() => {  // per bone 9 numbers of its linear part, 3 of its translation [mm]
    const bones = new Float32Array(12 * hand_bone_count);
    for (let b = 0; b < bones.length; b += 12) {
      for (let i = 0; i < 9; ++i) bones[b + i] = i16() / 4096;
      for (let i = 9; i < 12; ++i) bones[b + i] = 1e3 * f32();
    }
    return bones;
  });
  frame.end = p;
  return frame;
}

const quantities = {
  pressure: { title: 'contact pressure', unit: 'kPa', least: 1, of: (f, i) => f.pressure[i] },
  stretch: { title: 'stretch: departure from 1 (at a limit: blue)', unit: '%', least: 5, of: (f, i) => f.stretch[i] },
  displacement: { title: 'displacement from rest', unit: 'mm', least: 0.1, of: (f, i, rest) =>
    Math.hypot(f.position[3 * i] - rest[3 * i], f.position[3 * i + 1] - rest[3 * i + 1],
               f.position[3 * i + 2] - rest[3 * i + 2]) },
};
for (const q of Object.values(quantities)) { q.most = q.least; q.peaks = []; }
/** The scale of each finger's own pad: pressure [kPa] alone. */
const pad_scales = model.fingers.map(() => ({ least: 1, most: 1, peaks: [] }));
let pressure_fixed = null;  // by a person [kPa]: of all fingers, the same
/** Not below x, and reads well: as in pictures. */
function roundUp(x) {
  const power = Math.pow(10, Math.floor(Math.log10(x) + 1e-9)), m = x / power;
  return Number((power * [1, 1.2, 1.5, 2, 2.5, 3, 4, 5, 6, 8, 10].find(step => m <= step * (1 + 1e-6))).toPrecision(3));
}
/** Scales end where the scene or the run's pictures have their end, else where 19 of 20 frames with contact have their
    peak: single spikes do not wash out the rest. */
function fitScales() {
  for (const q of [...Object.values(quantities), ...pad_scales]) {
    const peaks = q.peaks.filter(peak => peak > q.least).sort((a, b) => a - b);
    if (peaks.length > 0) q.most = roundUp(peaks[Math.floor(0.95 * (peaks.length - 1))]);
    if (q.peaks.length > 20000) q.peaks.splice(0, 10000);
  }
  quantities.pressure.most = pressure_fixed || model.pressure_kPa || quantities.pressure.most;
  pad_scales.forEach((scale, k) => { scale.most = pressure_fixed || model.fingers[k].pressure_kPa || scale.most; });
}
// From skin over red and purple to nearly black: lightness falls evenly, so that it reads without seeing colours.
const skin_colours = [[236, 196, 172], [244, 143, 98], [222, 78, 88], [164, 38, 104], [98, 18, 104], [38, 8, 60]];
function skinColour(t) {
  t = Math.min(1, Math.max(0, t)) * (skin_colours.length - 1);
  const k = Math.min(skin_colours.length - 2, Math.floor(t)), a = skin_colours[k], b = skin_colours[k + 1];
  return [0, 1, 2].map(d => (a[d] + (t - k) * (b[d] - a[d])) / 255);
}
