'use strict';
// Names and forces at the fingers, in the stage's pixels: whole, beside each other, with a line to their finger.

const name_height = 19;
const name_lines = document.createElementNS('http://www.w3.org/2000/svg', 'svg');
name_lines.id = 'name-lines';
name_lines.setAttribute('aria-hidden', 'true');
by('stage').append(name_lines);
const tags = stage.fingers.map((finger, k) => {
  const tag = document.createElement('div');
  tag.className = 'tag';
  tag.style.color = palette[k % palette.length];
  by('stage').append(tag);
  const line = document.createElementNS('http://www.w3.org/2000/svg', 'line');
  line.setAttribute('stroke', palette[k % palette.length]);
  name_lines.append(line);
  return { tag, line };
});
const name_ruler = document.createElement('canvas').getContext('2d');

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

/** Names of a frame, for a camera that fills width x height. */
function showNames(frame, width, height) {
  const shown = by('names').checked && frame;
  name_lines.style.display = shown ? '' : 'none';
  for (const { tag } of tags) tag.hidden = !shown;
  if (!shown) return;
  const font = getComputedStyle(tags[0].tag);
  name_ruler.font = `${font.fontWeight} ${font.fontSize} ${font.fontFamily}`;
  const legend = by('legend'), taken = [{ x: 0, y: 0, w: legend.offsetLeft + legend.offsetWidth + 4, h: legend.offsetTop + legend.offsetHeight + 4 }];
  const wanted = fingers.map(({ group }, k) => {
    const at = new THREE.Vector3(-4, 0, 8).applyMatrix4(group.matrixWorld).project(camera);
    const x = (0.5 + at.x / 2) * width, y = (0.5 - at.y / 2) * height;
    const force = frame.fingers[k].force, text = stage.fingers[k].name + (force > 5e-4 ? ` ${force.toFixed(2)} N` : '');
    const w = name_ruler.measureText(text).width + 8, gap = Math.min(70, 0.12 * width);
    const left = x > width / 2 ? x + gap : x - gap - w;
    return { k, text, to: [x, y], seen: at.z <= 1 && x > -40 && x < width + 40 && y > -40 && y < height + 40,
      box: { x: Math.max(3, Math.min(width - w - 3, left)), y: y - 30, w, h: name_height } };
  });
  wanted.sort((a, b) => a.to[1] - b.to[1]);
  for (const { k, text, to, seen, box } of wanted) {
    const { tag, line } = tags[k];
    tag.hidden = !seen;
    line.style.display = seen ? '' : 'none';
    if (!seen) continue;
    const there = freePlace(box, taken, height);
    taken.push(there);
    if (tag.textContent !== text) tag.textContent = text;
    tag.style.transform = `translate(${there.x + 4}px, ${there.y}px)`;
    const from_x = there.x > to[0] ? there.x : there.x + there.w;
    Object.entries({ x1: from_x, y1: there.y + name_height / 2, x2: to[0], y2: to[1] }).forEach(([name, v]) => line.setAttribute(name, v.toFixed(1)));
  }
}
