'use strict';
// Names and forces at the fingers, in the viewport's pixels: whole, beside each other, with a line to their finger.

/** Lines from names to fingers are drawn with the scene: over it, a layer of the page's own would have to be blended into
    every picture. */
const name_lines = (() => {
  const world = new THREE.Scene(), from = new THREE.OrthographicCamera(0, 1, 0, 1, -1, 1), shape = new THREE.BufferGeometry();
  const colour = new THREE.Color(), count = model.fingers.length, lines = new THREE.LineSegments(shape, new THREE.LineBasicMaterial(
    { vertexColors: THREE.VertexColors, depthTest: false, transparent: true, opacity: 0.7 }));
  shape.setAttribute('position', new THREE.BufferAttribute(new Float32Array(6 * count), 3));
  shape.setAttribute('color', new THREE.BufferAttribute(Float32Array.from({ length: 6 * count }, (_, i) =>
    colour.set(palette[Math.floor(i / 6) % palette.length]).toArray()[i % 3]), 3));
  lines.frustumCulled = false;
  world.add(lines);
  const at = shape.attributes.position;
  /** The k-th, between two places in pixels; none without. */
  function lay(k, x1 = 0, y1 = 0, x2 = 0, y2 = 0) { at.array.set([x1, y1, 0, x2, y2, 0], 6 * k); at.needsUpdate = true; }
  function draw(width, height, part) {
    Object.assign(from, { right: width, bottom: height });
    from.updateProjectionMatrix();
    renderer.autoClear = false;
    part(world, from);
    renderer.autoClear = true;
  }
  return { lay, draw, world };
})();
const tags = model.fingers.map((finger, k) => {
  const tag = document.createElement('div');
  tag.className = 'tag';
  tag.dataset.finger = finger.name;  // whole, however short it is written
  tag.style.color = palette[k % palette.length];
  by('viewport').append(tag);
  return tag;
});
const name_ruler = document.createElement('canvas').getContext('2d');
let names_are_small = null;  // of which the ruler has the font

const overlap = (a, b) => a.x < b.x + b.w && b.x < a.x + a.w && a.y < b.y + b.h && b.y < a.y + a.h;
/** The nearest place above or below where a box covers none that are taken, within a height. */
function freePlace(box, taken, height) {
  for (let step = 0; step < height; ++step)
    for (const side of [1, -1]) {
      const there = { ...box, y: box.y + side * 3 * step };
      if (there.y >= 2 && there.y + there.h <= height - 2 && !taken.some(other => overlap(there, other))) return there;
    }
  return { ...box, y: Math.max(2, Math.min(height - box.h - 2, box.y)) };
}

/** "R thumb" for "right thumb". */
function sideInShort(name) { return name.replace(/^(left|right) /, side => side[0].toUpperCase() + ' '); }

/** Names of a frame, for a camera that fills width x height; many on a phone are short and small. */
function showNames(frame, width, height) {
  const shown = by('names').checked && frame, small = width < 500 && tags.length > 5, name_height = small ? 14 : 19;
  by('viewport').classList.toggle('small-names', small);
  name_lines.world.visible = Boolean(shown);
  for (const tag of tags) tag.hidden = !shown;
  if (!shown) return;
  if (small !== names_are_small) {
    const font = getComputedStyle(tags[0]);
    name_ruler.font = `${font.fontWeight} ${font.fontSize} ${font.fontFamily}`;
    names_are_small = small;
  }
  const legend = by('legend'), taken = [{ x: 0, y: 0, w: legend.offsetLeft + legend.offsetWidth + 4, h: legend.offsetTop + legend.offsetHeight + 4 }];
  const wanted = fingers.map(({ group }, k) => {
    const at = new THREE.Vector3(-4, 0, 8).applyMatrix4(group.matrixWorld).project(camera);
    const x = (0.5 + at.x / 2) * width, y = (0.5 - at.y / 2) * height;
    const force = frame.fingers[k].force, name = model.fingers[k].name;
    const text = (small ? sideInShort(name) : name) + (force > 5e-4 ? ` ${force.toFixed(small ? 1 : 2)} N` : '');
    const w = name_ruler.measureText(text).width + 8, gap = small ? 24 : Math.min(70, 0.12 * width);
    const left = x > width / 2 ? x + gap : x - gap - w;
    return { k, text, to: [x, y], seen: at.z <= 1 && x > -40 && x < width + 40 && y > -40 && y < height + 40,
      box: { x: Math.max(3, Math.min(width - w - 3, left)), y: y - 30, w, h: name_height } };
  });
  wanted.sort((a, b) => a.to[1] - b.to[1]);
  for (const { k, text, to, seen, box } of wanted) {
    const tag = tags[k];
    tag.hidden = !seen;
    name_lines.lay(k);
    if (!seen) continue;
    const there = freePlace(box, taken, height);
    taken.push(there);
    if (tag.textContent !== text) tag.textContent = text;
    tag.style.transform = `translate(${there.x + 4}px, ${there.y}px)`;
    const from_x = there.x > to[0] ? there.x : there.x + there.w;
    name_lines.lay(k, from_x, there.y + name_height / 2, to[0], to[1]);
  }
}
