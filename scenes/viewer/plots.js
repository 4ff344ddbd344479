'use strict';
// Curves over the time of a run, beside the scene: which to show is chosen, time is zoomed, and they are saved as SVG. What
// a plot holds is listed once, in items; a canvas and an SVG draw the same list.

const finger_curves = model.fingers.map((f, k) => ({ name: f.name, colour: palette[k % palette.length], finger: k }));
const thimble_curves = model.thimbles.map((t, k) => ({ ...finger_curves[t.finger], thimble: k }));
const joint_curves = thimble_curves.flatMap(curve => model.thimbles[curve.thimble].joint_min.map((_, joint) =>
  ({ ...curve, name: `${curve.name} ${joint + 1}`, joint })));
const plots = [
  { id: 'force', title: 'contact force [N]', curves: finger_curves, of: (f, c) => f.fingers[c.finger].force, shown: true },
  { id: 'area', title: 'contact area [mm²]', curves: finger_curves, of: (f, c) => 1e6 * f.fingers[c.finger].area, shown: true },
  { id: 'peak', title: 'pressure peak [kPa]', curves: finger_curves, of: (f, c) => f.fingers[c.finger].pressure.reduce(
    (a, b) => Math.max(a, b), 0) },
  { id: 'felt', title: 'force of the platform [N]', curves: thimble_curves, of: (f, c) => f.thimbles[c.thimble].felt.force },
  { id: 'joints', title: 'joint angles [°]', curves: joint_curves, of: (f, c) => f.thimbles[c.thimble].q[c.joint] * 180 / Math.PI },
  { id: 'residual', title: 'matching residual [mm]', curves: thimble_curves, of: (f, c) => 1e3 * f.thimbles[c.thimble].rms,
    shown: true },
  { id: 'converged', title: 'steps converged [%]', curves: finger_curves,
    of: (f, c) => f.steps > 0 ? 100 * f.fingers[c.finger].converged / f.steps : 100 },
  { id: 'step', title: 'longest step [µs] (line: the time step)', curves: [{ name: 'step', colour: '#868e96' }],
    of: f => f.step_us, line: 1e6 * model.dt, shown: true },
].filter(plot => plot.curves.length > 0);
for (const plot of plots) plot.curves = plot.curves.map(curve => ({ ...curve, values: [] }));

let span = null;  // the time shown, [from, until]; null: all
function timeSpan() {
  const first = frames[0].time, last = frames[frames.length - 1].time;
  return span || [first, Math.max(first + 1e-6, last)];
}
/** Shows the time from a to b, of what there is and not below a few frames. */
function zoomTime(a, b) {
  const first = frames[0].time, last = frames[frames.length - 1].time, least = Math.min(last - first, 4 * model.dt);
  if (b - a < least) [a, b] = [(a + b - least) / 2, (a + b + least) / 2];
  span = a <= first && b >= last ? null : [Math.max(a, first), Math.min(b, last)];
  drawPlots();
}
function zoomTimeBy(factor, about = frames[now].time) {
  const [a, b] = timeSpan();
  zoomTime(about - factor * (about - a), about + factor * (b - about));
}
function showAllTime() { span = null; drawPlots(); }
function frameNear(time) {
  let k = 0;
  while (k + 1 < frames.length && Math.abs(frames[k + 1].time - time) <= Math.abs(frames[k].time - time)) ++k;
  return k;
}

const short = v => String(Number(v.toPrecision(3)));
const left = 44, right = 8, top_edge = 18, bottom = 16;
/** What a plot of w x h consists of: frame, texts, lines in pixels, and curves by time and value. */
function itemsOf(plot, w, h) {
  const [t0, t1] = timeSpan(), inside = [];
  frames.forEach((f, i) => { if (f.time >= t0 - 1e-9 && f.time <= t1 + 1e-9) inside.push(i); });
  let low = 0, high = 1e-9;
  for (const { values } of plot.curves)
    for (const i of inside) low = Math.min(low, values[i]), high = Math.max(high, values[i]);
  const sx = (w - left - right) / (t1 - t0), sy = -(h - top_edge - bottom) / (high - low);
  const x = t => left + sx * (t - t0), y = v => top_edge + sy * (v - high);
  const across = v => [[left, y(v)], [w - right, y(v)]], up = t => [[x(t), top_edge], [x(t), h - bottom]];
  const lines = [{ at: [...across(high), ...across(low).reverse(), across(high)[0]], colour: 'border' }];
  if (low < 0) lines.push({ at: across(0), colour: 'border' });
  if (plot.line <= high) lines.push({ at: across(plot.line), colour: '#c62828', dashed: true });
  const time = frames[now].time, cursor = time >= t0 - 1e-9 && time <= t1 + 1e-9 ? { at: up(time), colour: 'ink' } : null;
  const texts = [{ text: plot.title, x: left, y: 12, colour: 'ink', align: 'start' },
    { text: short(low), x: left - 4, y: y(low) + 4, colour: 'soft', align: 'end' },
    { text: t0.toFixed(2), x: left, y: h - 3, colour: 'soft', align: 'start' },
    { text: t1.toFixed(2) + ' s', x: w - right, y: h - 3, colour: 'soft', align: 'end' }];
  if (high > 1e-6) texts.push({ text: short(high), x: left - 4, y: y(high) + 4, colour: 'soft', align: 'end' });
  const curves = plot.curves.map(c => ({ name: c.name, colour: c.colour, at: inside.map(i => [frames[i].time, c.values[i]]) }));
  return { lines, texts, curves, cursor, x, y, sx, sy };
}

const plot_colours = { ink: '--ink', soft: '--soft', border: '--line' };
for (const name of Object.keys(plot_colours)) plot_colours[name] = getComputedStyle(document.body).getPropertyValue(plot_colours[name]);
function strokeLine(g, { at, colour, dashed }) {
  g.strokeStyle = plot_colours[colour] || colour;
  g.setLineDash(dashed ? [4, 3] : []);
  g.beginPath();
  at.forEach(([x, y], i) => i ? g.lineTo(x, y) : g.moveTo(x, y));
  g.stroke();
}
/** All of a plot but what moves with the time and the pointer, on a canvas of its own. */
function drawCurves(g, items) {
  g.font = '11px system-ui, sans-serif';
  for (const line of items.lines) strokeLine(g, line);
  for (const curve of items.curves) strokeLine(g, { at: curve.at.map(([t, v]) => [items.x(t), items.y(v)]), colour: curve.colour });
  for (const text of items.texts) {
    g.fillStyle = plot_colours[text.colour];
    g.textAlign = text.align;
    g.fillText(text.text, text.x, text.y);
  }
}
/** Draws those that are shown: their curves anew only where these have changed. */
function drawPlots() {
  if (frames.length === 0) return;
  for (const plot of plots) {
    plot.canvas.hidden = !plot.shown;
    if (!plot.shown) continue;
    const c = plot.canvas, ratio = window.devicePixelRatio || 1, w = c.clientWidth, h = c.clientHeight, g = c.getContext('2d');
    const drawn = [w, h, ratio, ...timeSpan(), frames.length].join(), [t0, t1] = timeSpan(), time = frames[now].time;
    if (drawn !== plot.drawn) {
      c.width = plot.still.width = w * ratio, c.height = plot.still.height = h * ratio;
      const still = plot.still.getContext('2d');
      still.scale(ratio, ratio);
      drawCurves(still, itemsOf(plot, w, h));
      plot.drawn = drawn;
    }
    g.setTransform(1, 0, 0, 1, 0, 0);
    g.clearRect(0, 0, c.width, c.height);
    g.drawImage(plot.still, 0, 0);
    g.scale(ratio, ratio);
    const at = left + (w - left - right) * (time - t0) / (t1 - t0);
    if (time >= t0 - 1e-9 && time <= t1 + 1e-9) strokeLine(g, { at: [[at, top_edge], [at, h - bottom]], colour: 'ink' });
    if (plot.marked) {
      g.fillStyle = 'rgba(110, 168, 254, 0.3)';
      g.fillRect(plot.marked[0], top_edge, plot.marked[1] - plot.marked[0], h - top_edge - bottom);
    }
  }
}

/** The plots shown, one below the other. Points of a curve are times and values as they are; its transform places them. */
function plotsSvg(w = 640, h = 170) {
  const colours = { ink: '#1c2430', soft: '#5b6675', border: '#d5dbe3' };
  const list = plots.filter(plot => plot.shown);
  const points = at => at.map(([x, y]) => `${Number(x.toPrecision(7))},${Number(y.toPrecision(6))}`).join(' ');
  const one = (plot, k) => {
    const items = itemsOf(plot, w, h - 16);
    const transform = `matrix(${items.sx} 0 0 ${items.sy} ${items.x(0)} ${items.y(0)})`;
    const texts = items.texts.concat(plot.curves.length === 1 ? [] : plot.curves.map((c, i) =>
      ({ text: c.name, x: left + (w - left - right) * i / plot.curves.length, y: h - 6, colour: c.colour, align: 'start' })));
    return `<g transform="translate(0 ${20 + k * h})" data-quantity="${plot.id}">\n` +
      items.lines.concat(items.cursor || []).map(l => `<polyline points="${points(l.at)}" stroke="${colours[l.colour] || l.colour}"${
        l.dashed ? ' stroke-dasharray="4 3"' : ''}/>\n`).join('') +
      items.curves.map(c => `<polyline class="curve" data-name="${inHtml(c.name)}" transform="${transform}" stroke="${c.colour}" ` +
        `vector-effect="non-scaling-stroke" points="${points(c.at)}"/>\n`).join('') +
      texts.map(t => `<text x="${t.x.toFixed(1)}" y="${t.y.toFixed(1)}" text-anchor="${t.align}" stroke="none" fill="${
        colours[t.colour] || t.colour}">${inHtml(t.text)}</text>\n`).join('') + '</g>\n';
  };
  return `<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 ${w} ${20 + list.length * h}" width="${w}" height="${
    20 + list.length * h}" font-family="sans-serif" font-size="11" fill="none">\n<rect width="100%" height="100%" fill="#fff"/>\n` +
    `<text x="${left}" y="14" font-weight="600" fill="#1c2430">${inHtml(model.title)}</text>\n${list.map(one).join('')}</svg>\n`;
}

/** Keys: the next quantity alone, and all at last. */
function nextQuantity() {
  const shown = plots.filter(plot => plot.shown), next = shown.length === 1 ? plots.indexOf(shown[0]) + 1 : 0;
  plots.forEach((plot, k) => { plot.box.checked = plot.shown = next === plots.length || k === next; });
  drawPlots();
}

for (const plot of plots) {
  plot.box = Object.assign(document.createElement('input'), { type: 'checkbox', checked: Boolean(plot.shown), id: 'plot-' + plot.id });
  plot.box.onchange = () => { plot.shown = plot.box.checked; drawPlots(); };
  const label = document.createElement('label');
  label.append(plot.box, plot.title.replace(/ [[(].*/, ''));
  by('quantities').append(label);
  plot.canvas = document.createElement('canvas');
  plot.still = document.createElement('canvas');
  plot.canvas.className = 'plot';
  plot.canvas.setAttribute('role', 'img');
  plot.canvas.setAttribute('aria-label', plot.title + ' over time');
  by('plots').appendChild(plot.canvas);
  const pixelOf = event => event.clientX - plot.canvas.getBoundingClientRect().left;
  const timeAt = pixel => {
    const share = Math.min(1, Math.max(0, (pixel - left) / (plot.canvas.clientWidth - left - right))), [t0, t1] = timeSpan();
    return t0 + share * (t1 - t0);
  };
  let from = null;  // where a drag began
  plot.canvas.onpointerdown = event => { from = pixelOf(event); plot.canvas.setPointerCapture(event.pointerId); };
  plot.canvas.onpointermove = event => {
    if (frames.length === 0) return;
    const k = frameNear(timeAt(pixelOf(event)));
    by('hover').hidden = false;
    by('hover').innerHTML = `${frames[k].time.toFixed(3)} s<br>` + plot.curves.map(curve =>
      `<span style="color:${curve.colour}">${Number(curve.values[k]).toPrecision(4)}</span>`).join('<br>');
    Object.assign(by('hover').style, { left: Math.min(event.clientX + 12, window.innerWidth - 70) + 'px', top: event.clientY + 8 + 'px' });
    if (from === null) return;
    plot.marked = [from, pixelOf(event)];
    drawPlots();
  };
  plot.canvas.onpointerleave = () => { by('hover').hidden = true; };
  plot.canvas.onpointercancel = () => { from = plot.marked = null; };
  plot.canvas.onpointerup = event => {
    if (frames.length === 0 || from === null) return;
    const ends = [from, pixelOf(event)].sort((a, b) => a - b);
    from = plot.marked = null;
    if (ends[1] - ends[0] > 4) zoomTime(timeAt(ends[0]), timeAt(ends[1]));
    else { play(false); show(frameNear(timeAt(ends[0]))); }
  };
  plot.canvas.ondblclick = showAllTime;
  plot.canvas.onwheel = event => {
    if (frames.length === 0) return;
    event.preventDefault();
    zoomTimeBy(event.deltaY < 0 ? 0.8 : 1.25, timeAt(pixelOf(event)));
  };
}
