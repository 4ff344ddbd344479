'use strict';
// The hand that fingertips belong to: its skin at rest follows its bones, which come with every frame. It takes no part in
// the simulation.

const hand_colour = '#e6c2ab';

/** Skin of a hand; show(bones) poses it. */
function handOf(hand) {
  const { vertices, bones: follows, second } = stage.hand_skin, count = second.length, { triangles } = hand;
  const geometry = new THREE.BufferGeometry(), position = new Float32Array(3 * count);
  geometry.setAttribute('position', new THREE.BufferAttribute(position, 3));
  geometry.setAttribute('normal', new THREE.BufferAttribute(new Float32Array(3 * count), 3));
  geometry.setIndex(triangles);
  const group = nearestSurface(geometry, hand_colour, 1);
  for (const part of group.children) part.frustumCulled = false;
  function show(bones) {
    for (let v = 0; v < count; ++v) {
      const x = 1e-2 * vertices[3 * v], y = 1e-2 * vertices[3 * v + 1], z = 1e-2 * vertices[3 * v + 2];
      const a = 12 * follows[2 * v], b = 12 * follows[2 * v + 1], w = 1e-2 * second[v];
      for (let d = 0; d < 3; ++d) {
        const p = a + 3 * d, q = b + 3 * d;
        position[3 * v + d] =
          (1 - w) * (bones[p] * x + bones[p + 1] * y + bones[p + 2] * z + bones[a + 9 + d]) +
          w * (bones[q] * x + bones[q + 1] * y + bones[q + 2] * z + bones[b + 9 + d]);
      }
    }
    geometry.attributes.normal.array.set(normalsOf(position, triangles));
    geometry.attributes.position.needsUpdate = geometry.attributes.normal.needsUpdate = true;
  }
  return { group, show };
}
