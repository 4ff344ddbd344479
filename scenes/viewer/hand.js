'use strict';
// The hand that fingertips belong to: its skin at rest follows its bones, which come with every frame. It takes no part in
// the simulation.

const hand_colour = '#e6c2ab';

/** Fewer vertices and triangles of a surface: of all vertices of one cell and one bone, the one nearest to their middle. */
function coarserHand(triangles, cell) {
  const { vertices, bones } = model.hand_skin, count = vertices.length / 3, cells = new Map(), stands_for = new Int32Array(count);
  for (let v = 0; v < count; ++v) {
    const key = [0, 1, 2].map(d => Math.floor(1e-2 * vertices[3 * v + d] / cell)).join() + ':' + bones[2 * v];
    if (!cells.has(key)) cells.set(key, []);
    cells.get(key).push(v);
  }
  for (const members of cells.values()) {
    const middle = [0, 1, 2].map(d => members.reduce((sum, v) => sum + vertices[3 * v + d], 0) / members.length);
    const far = v => Math.hypot(...middle.map((x, d) => vertices[3 * v + d] - x));
    const nearest = members.reduce((a, b) => far(b) < far(a) ? b : a);
    for (const v of members) stands_for[v] = nearest;
  }
  const out = [];
  for (let t = 0; t < triangles.length; t += 3) {
    const [a, b, c] = [0, 1, 2].map(k => stands_for[triangles[t + k]]);
    if (a !== b && b !== c && c !== a) out.push(a, b, c);
  }
  return out;
}
/** A posed part of the hand's skin: show(bones). */
function handShape(triangles) {
  const { vertices, bones: follows, second } = model.hand_skin, number = new Map(), used = [];
  const index = triangles.map(v => {
    if (!number.has(v)) number.set(v, used.push(v) - 1);
    return number.get(v);
  });
  const geometry = new THREE.BufferGeometry(), position = new Float32Array(3 * used.length);
  geometry.setAttribute('position', new THREE.BufferAttribute(position, 3));
  geometry.setAttribute('normal', new THREE.BufferAttribute(new Float32Array(3 * used.length), 3));
  geometry.setIndex(index);
  function show(bones) {
    used.forEach((v, k) => {
      const x = 1e-2 * vertices[3 * v], y = 1e-2 * vertices[3 * v + 1], z = 1e-2 * vertices[3 * v + 2];
      const a = 12 * follows[2 * v], b = 12 * follows[2 * v + 1], w = 1e-2 * second[v];
      for (let d = 0; d < 3; ++d) {
        const p = a + 3 * d, q = b + 3 * d;
        position[3 * k + d] =
          (1 - w) * (bones[p] * x + bones[p + 1] * y + bones[p + 2] * z + bones[a + 9 + d]) +
          w * (bones[q] * x + bones[q + 1] * y + bones[q + 2] * z + bones[b + 9 + d]);
      }
    });
    geometry.attributes.normal.array.set(normalsOf(position, index));
    geometry.attributes.position.needsUpdate = geometry.attributes.normal.needsUpdate = true;
  }
  return { geometry, show };
}

/** Skin of a hand; show(bones) poses it, as finely as is asked for then. */
function handOf(hand) {
  const shapes = { fine: () => handShape(hand.triangles), coarse: () => handShape(coarserHand(hand.triangles, 9)) }, made = {};
  const mesh = clearedSurface(new THREE.BufferGeometry(), hand_colour);
  mesh.frustumCulled = false;
  function show(bones) {
    const shape = made[detail.hand] || (made[detail.hand] = shapes[detail.hand]());
    shape.show(bones);
    mesh.geometry = shape.geometry;
  }
  return { mesh, show };
}
