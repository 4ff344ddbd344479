'use strict';
// How finely things are drawn. A picture that stays is drawn as finely as it can be; one of many that follow each other,
// only as finely as leaves them 30 a second: without a graphics card that means fewer triangles and pixels, pads and
// tables in turns.

/** Whether pixels are drawn without a graphics card: then edges are smoothed only where the picture stands still. */
const drawn_in_software = (() => {
  const gl = document.createElement('canvas').getContext('webgl'), about = gl && gl.getExtension('WEBGL_debug_renderer_info');
  return Boolean(about) && /swiftshader|llvmpipe|softpipe|software|basic render/i.test(gl.getParameter(about.UNMASKED_RENDERER_WEBGL));
})();

/** rows: small triangles along an edge of a skin's face; ratio: pixels per pixel of the page; turns: of the pads and of
    what stands beside the scene, one of so many is drawn anew with a picture. */
const details = [
  { rows: 3, ratio: 1, turns: 1, hand: 'fine' },
  { rows: 2, ratio: 0.8, turns: 4, hand: 'coarse' },
  { rows: 1, ratio: 0.75, turns: 5, hand: 'coarse' },
  { rows: 1, ratio: 0.5, turns: 8, hand: 'coarse' },
];
const detail = { level: 0, turn: 0, late: 0, ...details[0] };
function setDetail(level) { Object.assign(detail, details[level], { level }); }
/** Whether pictures follow each other from now on, and so many fingers are in them. */
function beginDetail(moving, finger_count) {
  detail.late = 0;
  setDetail(moving && drawn_in_software ? (finger_count > 5 ? 2 : 1) : 0);
}
/** Told how long a picture was after the one before [ms], it draws coarser where several have come late. */
function paceDetail(passed) {
  detail.late = Math.max(0, detail.late + (passed > 40 ? 1 : -0.5));
  if (detail.late < 6 || detail.level + 1 >= details.length) return;
  detail.late = 0;
  setDetail(detail.level + 1);
}
/** Whether the k-th of several things is drawn anew with this picture. */
function isTurn(k) { return (detail.turn + k) % detail.turns === 0; }
