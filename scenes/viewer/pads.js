'use strict';
// Below the scene, each finger's pad from its contact side, the tip up: pressure on a scale of its own, the edge of the
// touched area, the centre of pressure; and beside it, with a thimble, what its platform makes the pad feel, on the same
// scale.

/** From where each finger's pad is seen: the middle of its skin in the middle, all at one scale. */
const pad_cameras = (() => {
  const ends = model.fingers.map(({ rest }) => [0, 1].map(d => {
    const along = rest.filter((_, i) => i % 3 === d);
    return [Math.min(...along), Math.max(...along)];
  }));
  const reach = 0.6 + Math.max(14, ...ends.flat().map(([low, high]) => (high - low) / 2));  // [mm]
  return ends.map(([[low, high]]) => {
    const from = new THREE.OrthographicCamera(-reach, reach, reach, -reach, 1, 400), middle = (low + high) / 2;
    from.up.set(1, 0, 0);
    from.position.set(middle, 0, -200);
    from.lookAt(middle, 0, 0);
    return from;
  });
})();

function padCell(kind, finger) {
  const world = new THREE.Scene(), label = document.createElement('div');
  world.add(new THREE.HemisphereLight('#ffffff', '#c9ced6', 0.85), sun.clone());
  world.background = new THREE.Color(dark ? '#20262f' : '#ffffff');
  label.className = 'pad';
  label.innerHTML = '<b></b><span></span><i><canvas width="64" height="1"></canvas><em></em></i>';
  by('viewport').append(label);
  const g = label.querySelector('canvas').getContext('2d');
  for (let i = 0; i < 64; ++i) {
    g.fillStyle = 'rgb(' + skinColour(i / 63).map(c => Math.round(255 * c)).join(',') + ')';
    g.fillRect(i, 0, 1, 1);
  }
  const [name, numbers, scale] = ['b', 'span', 'em'].map(part => label.querySelector(part));
  return { kind, finger, world, label, name, numbers, scale };
}
/** Lines drawn over a pad; set(points [mm]) in pairs. */
function padLines(colour, most) {
  const shape = new THREE.BufferGeometry(), at = new THREE.BufferAttribute(new Float32Array(6 * most), 3);
  shape.setAttribute('position', at);
  const lines = new THREE.LineSegments(shape, new THREE.LineBasicMaterial({ color: colour, depthTest: false, transparent: true }));
  lines.frustumCulled = false;
  return { lines, set: points => {
    at.array.set(points.slice(0, at.array.length));
    at.needsUpdate = true;
    shape.setDrawRange(0, Math.min(points.length, at.array.length) / 3);
  } };
}

const pads = model.fingers.map((finger, k) => {
  const cell = padCell('pad', k), skin = fingers[k].twin();
  const edge = padLines('#0d0d1a', finger.triangles.length / 3), halo = padLines('#ffffff', 4), cross = padLines('#000000', 2);
  cell.world.add(skin.mesh, edge.lines, halo.lines, cross.lines);
  return { ...cell, skin, edge, halo, cross };
});
const felt_pads = model.thimbles.map((thimble, k) => {
  const cell = padCell('felt', thimble.finger), skin = skinOf(model.fingers[thimble.finger]), disk = rimOf(thimble, 0.25);
  cell.world.add(skin.group, disk);
  return { ...cell, thimble: k, skin, disk };
});

/** Where the forces on a pad's samples act on average, bone frame [mm]; null where nothing presses. */
function centreOfPressure(f, samples) {
  const centre = [0, 0, 0];
  let sum = 0;
  samples.forEach((node, s) => {
    const force = Math.hypot(f.forces[3 * s], f.forces[3 * s + 1], f.forces[3 * s + 2]);
    for (let d = 0; d < 3; ++d) centre[d] += force * f.position[3 * node + d];
    sum += force;
  });
  return sum < 1e-3 ? null : centre.map(x => x / sum);
}

/** Brings a cell to what a frame has. */
function showCell(cell, frame) {
  const { most } = pad_scales[cell.finger], end = `${most} kPa`;
  const numbers = cell.kind === 'pad' ? showPad(cell, frame.fingers[cell.finger], most) : showFelt(cell, frame.thimbles[cell.thimble], most);
  if (cell.numbers.textContent !== numbers) cell.numbers.textContent = numbers;
  if (cell.scale.textContent !== end) cell.scale.textContent = end;
}
function showPad(pad, f, most) {
  const { samples } = model.fingers[pad.finger];
  pad.skin.paint(i => f.pressure[i]);
  pad.skin.scale.most.value = most;
  pad.edge.set(f.outline);
  const c = centreOfPressure(f, samples);
  const arms = (size, off) => c ? [c[0] - size, c[1] + off, c[2], c[0] + size, c[1] + off, c[2],
    c[0] + off, c[1] - size, c[2], c[0] + off, c[1] + size, c[2]] : [];
  pad.halo.set([...arms(1.8, 0.22), ...arms(1.8, -0.22)]);
  pad.cross.set(arms(1.6, 0));
  return f.force > 5e-4 ? `${f.force.toFixed(2)} N\n${(1e6 * f.area).toFixed(0)} mm²` : 'free';
}
function showFelt(felt, t, most) {
  felt.skin.show(t.felt.position, i => t.felt.pressure[i]);
  felt.skin.scale.most.value = most;
  place(felt.disk, t.pose);
  felt.name.textContent = by('pads').checked ? 'feels' : `${model.fingers[felt.finger].name} feels`;
  return `${t.felt.force.toFixed(2)} N`;
}

const least_side = 62, label_height = 66, gap = 6;
/** Cells in as few rows as leave them large enough to read; rows alike, an even number of columns where `pairs`. */
function rowsOf(cells, pairs, width, height) {
  let best = null;
  for (let rows = 1; rows <= 4 && !(best && best.side >= 84); ++rows) {
    let columns = Math.max(1, Math.ceil(cells.length / rows));
    if (pairs && columns % 2) ++columns;
    const side = Math.floor(Math.min(150, (width - gap) / columns - gap, 0.5 * height / rows - label_height));
    const row = side + label_height;
    if (!best || side > best.side) best = { cells, columns, side, row, height: cells.length > 0 ? rows * row : 0 };
  }
  return best.side >= 30 ? best : { cells: [], height: 0 };
}
/** The cells that are asked for; where so many would be too small, those of pads alone. */
function padRows(width, height) {
  const both = by('pads').checked && by('felt').checked && felt_pads.length > 0, cells = [];
  for (const pad of pads) {
    if (by('pads').checked) cells.push(pad);
    if (by('felt').checked) cells.push(...felt_pads.filter(felt => felt.finger === pad.finger));
  }
  const rows = rowsOf(cells, both && felt_pads.length === pads.length, width, height);
  return both && !(rows.side >= least_side) ? rowsOf(pads, false, width, height) : rows;
}
let last_layout = '';
/** Draws the cells of a frame below the scene, all or those whose turn it is, by part(x, y from below, width, height,
    world, camera). */
function drawPads(layout, width, frame, all, part) {
  const { columns, side, row } = layout, wide = side + gap, left = (width - columns * wide + gap) / 2;
  const here = k => [left + (k % columns) * wide, layout.height - row * Math.floor(k / columns) - side - 2];
  const now = [width, side, layout.height, layout.cells.map(cell => cell.kind + cell.finger)].join();
  if (now !== last_layout) {
    last_layout = now;
    for (const cell of [...pads, ...felt_pads]) cell.label.hidden = !layout.cells.includes(cell);
    layout.cells.forEach((cell, k) => {
      if (cell.kind === 'pad') cell.name.textContent = side < 84 ? sideInShort(model.fingers[cell.finger].name) : model.fingers[cell.finger].name;
      const [x, y] = here(k);
      cell.label.classList.toggle('narrow', side < 84);
      Object.assign(cell.label.style, { left: x - 2.5 + 'px', bottom: (y - (row - side) + 4) + 'px', width: side + 5 + 'px', height: (row - side - 6) + 'px' });
    });
  }
  layout.cells.forEach((cell, k) => {
    if (!all && !isTurn(k)) return;
    showCell(cell, frame);
    part(...here(k), side, side, cell.world, pad_cameras[cell.finger]);
  });
}
