'use strict';
// A thimble as a mechanism: two frames, servos with their cranks, links, and the platform as a ring with spokes, through
// which one sees the pad. In the frame of its finger.

const bar_shape = new THREE.CylinderBufferGeometry(1, 1, 1, 10).rotateX(Math.PI / 2);  // along z
const mechanism_colours = { frame: '#5c6b78', crank: '#e0871a', link: '#404d59', ring: '#2e9e45' };
for (const [part, color] of Object.entries(mechanism_colours))
  mechanism_colours[part] = new THREE.MeshLambertMaterial({ color });

const z_axis = new THREE.Vector3(0, 0, 1);
/** Lays a bar from a to b [mm]. */
function layBar(bar, a, b, radius) {
  const way = b.clone().sub(a), length = way.length();
  bar.visible = length > 1e-3;
  bar.position.copy(a).add(b).multiplyScalar(0.5);
  bar.scale.set(radius, radius, Math.max(length, 1e-3));
  if (bar.visible) bar.quaternion.setFromUnitVectors(z_axis, way.divideScalar(length));
}

/** The edge of a thimble's platform, z towards the pad. */
function rimOf(thimble, thickness) {
  return new THREE.Mesh(new THREE.TorusBufferGeometry(1e3 * thimble.radius, thickness, 8, 40), mechanism_colours.ring);
}
function platformOf(thimble) {
  const disk = new THREE.Group(), r = 1e3 * thimble.radius;
  disk.add(rimOf(thimble, 0.8));
  for (let k = 0; k < 3; ++k) {
    const spoke = new THREE.Mesh(bar_shape, mechanism_colours.ring), turn = 2 * Math.PI * k / 3;
    layBar(spoke, new THREE.Vector3(), new THREE.Vector3(r * Math.cos(turn), r * Math.sin(turn), 0), 0.3);
    disk.add(spoke);
  }
  return disk;
}

/** show(t) moves it to a thimble of a frame. */
function mechanismOf(thimble) {
  const holder = new THREE.Group(), disk = platformOf(thimble), lines = thimble.links;
  holder.add(disk);
  const bar = part => {
    const mesh = new THREE.Mesh(bar_shape, mechanism_colours[part]);
    holder.add(mesh);
    return mesh;
  };
  // The first two lines of several are frames; the first part of any other of several parts is a crank, on its servo.
  const parts = [];
  lines.forEach((count, line) => {
    const is_frame = line < 2 && lines.length > 2 && count > 2;
    for (let k = 0; k + 1 < count; ++k) {
      const part = is_frame ? 'frame' : count > 2 && k === 0 ? 'crank' : 'link';
      parts.push({ line, k, bar: bar(part), radius: { frame: 0.9, crank: 1, link: 0.6 }[part],
        drum: part === 'crank' ? bar('frame') : null });
    }
  });
  const at = (points, k) => new THREE.Vector3().fromArray(points, 3 * k);
  function show(t) {
    place(disk, t.pose);
    for (const { line, k, bar: one, radius, drum } of parts) {
      const a = at(t.links[line], k), b = at(t.links[line], k + 1);
      layBar(one, a, b, radius);
      if (!drum) continue;
      const across = b.clone().sub(a).cross(at(t.links[line], k + 2).sub(b));
      drum.visible = across.length() > 1e-6;
      if (drum.visible) layBar(drum, a.clone().sub(across.setLength(2.6)), a.clone().add(across), 2.1);
    }
  }
  return { holder, show };
}
