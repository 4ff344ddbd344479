'use strict';
// Everything by keys; `?` lists them.

const toggle = id => { by(id).checked = !by(id).checked; by(id).onchange(); };
const key_actions = [
  [' ', 'play, pause', () => play(!playing)],
  ['ArrowLeft', 'one frame back', () => by('back').onclick()],
  ['ArrowRight', 'one frame on', () => by('forth').onclick()],
  ['Home', 'to the start', () => { play(false); show(0); }],
  ['End', 'to the end', () => { play(false); show(frames.length - 1); }],
  ['0', 'look at all fingers', () => look(-1)],
  ['1 ... 9', 'look at one finger', null],
  ['+', 'nearer', () => zoom(0.8)],
  ['-', 'farther', () => zoom(1.25)],
  ['c', 'next colouring', () => nextOf('colour')],
  ['s', 'next speed', () => nextOf('speed')],
  ['f', 'forces', () => toggle('arrows')],
  ['h', 'the hand', () => toggle('hand')],
  ['t', 'thimbles', () => toggle('platforms')],
  ['o', 'objects', () => toggle('objects')],
  ['n', 'names', () => toggle('names')],
  ['m', 'the mesh', () => toggle('mesh')],
  ['b', 'pads from below', () => toggle('pads')],
  ['p', 'what fingers feel', () => toggle('felt')],
  ['q', 'one quantity after the other, then all plots', () => nextQuantity()],
  ['z', 'plots: less time', () => zoomTimeBy(0.5)],
  ['Z', 'plots: more time', () => zoomTimeBy(2)],
  ['a', 'plots: all time', () => showAllTime()],
  ['v', 'save the plots (SVG)', () => savePlots()],
  ['w', 'save the picture (PNG)', () => savePicture()],
  ['?', 'this list', () => { by('keys').hidden = !by('keys').hidden; }],
  ['Escape', 'close it', () => { by('keys').hidden = true; }],
];
const key_names = { ' ': 'space', ArrowLeft: '←', ArrowRight: '→', Escape: 'Esc' };

function look(finger) { by('camera').value = finger; aim(finger); }
function nextOf(id) {
  const list = by(id);
  list.selectedIndex = (list.selectedIndex + 1) % list.options.length;
  if (list.onchange) list.onchange();
}
function save(address, name) {
  const link = Object.assign(document.createElement('a'), { download: name, href: address });
  link.click();
}
/** The viewport as one sees it: what is drawn, and the names and numbers over it. */
function viewportPicture() {
  const picture = document.createElement('canvas'), g = picture.getContext('2d'), drawn = renderer.domElement;
  Object.assign(picture, { width: drawn.width, height: drawn.height });
  g.drawImage(drawn, 0, 0);
  const from = by('viewport').getBoundingClientRect(), scale = drawn.width / from.width;
  g.scale(scale, scale);
  g.textBaseline = 'top';
  for (const element of by('viewport').querySelectorAll('.tag, .pad b, .pad span, .pad em, .pad canvas, #legend div, #legend span, #legend canvas')) {
    const box = element.getBoundingClientRect(), look = getComputedStyle(element);
    if (box.width === 0) continue;
    if (element.tagName === 'CANVAS') g.drawImage(element, box.left - from.left, box.top - from.top, box.width, box.height);
    if (element.tagName === 'CANVAS' || element.childElementCount > 0) continue;
    Object.assign(g, { font: `${look.fontWeight} ${look.fontSize} ${look.fontFamily}`, fillStyle: look.color, textAlign: look.textAlign === 'center' ? 'center' : 'left' });
    const x = look.textAlign === 'center' ? (box.left + box.right) / 2 : box.left;
    element.textContent.split('\n').forEach((text, k, all) => g.fillText(text, x - from.left, box.top - from.top + k * box.height / all.length));
  }
  return picture;
}
function savePicture() {
  save(viewportPicture().toDataURL('image/png'), `${model.title} ${frames[now].time.toFixed(3)} s.png`);
}
function savePlots() { save('data:image/svg+xml,' + encodeURIComponent(plotsSvg()), model.title + '.svg'); }
by('save-picture').onclick = () => { if (frames.length > 0) savePicture(); };
by('save-plots').onclick = () => { if (frames.length > 0) savePlots(); };

by('keys').innerHTML = '<h2>Keys</h2><table>' + key_actions.map(([key, what]) =>
  `<tr><td><kbd>${key_names[key] || key}</kbd></td><td>${what}</td></tr>`).join('') + '</table>';
by('help').onclick = () => { by('keys').hidden = !by('keys').hidden; };
window.addEventListener('keydown', event => {
  if (event.ctrlKey || event.metaKey || event.altKey || /^(SELECT|TEXTAREA)$/.test(event.target.tagName)) return;
  if (event.target.tagName === 'INPUT' && (event.target.type === 'number' || event.key.startsWith('Arrow'))) return;
  if (/^(INPUT|BUTTON|SUMMARY)$/.test(event.target.tagName) && event.target.type !== 'range' && /^( |Enter)$/.test(event.key)) return;
  const finger = Number(event.key) - 1;
  const action = finger >= 0 && finger < model.fingers.length ? () => look(finger)
    : (key_actions.find(([key]) => key === event.key) || [])[2];
  if (!action || frames.length === 0) return;
  event.preventDefault();
  action();
});

// A link such as report.html#plots=force,joints chooses quantities; the ids of plots.js.
if (link.has('plots')) {
  const wanted = link.get('plots').split(',');
  for (const plot of plots) plot.box.checked = plot.shown = wanted.includes(plot.id);
  drawPlots();
}
// A link such as report.html#keys=End,ArrowLeft&hover=0.4 types and points, and &svg=1 keeps the plots; tests use it.
if (link.has('keys'))
  for (const key of link.get('keys').split(',')) window.dispatchEvent(new KeyboardEvent('keydown', { key, cancelable: true }));
if (link.has('hover') && frames.length > 0) {
  const { canvas } = plots.find(plot => plot.shown), box = canvas.getBoundingClientRect(), [t0, t1] = timeSpan();
  const share = (Number(link.get('hover')) - t0) / (t1 - t0);
  canvas.dispatchEvent(new PointerEvent('pointermove', { clientX: box.left + 44 + share * (box.width - 52) }));
  document.body.dataset.hover = by('hover').innerText.replace(/\s+/g, ' ');
}
if (link.has('svg') && frames.length > 0) document.body.dataset.svg = encodeURIComponent(plotsSvg());
if (link.has('probe') && frames.length > 0) probe();
