'use strict';
// A thimble as a mechanism: two frames, servos with their cranks, links, and the platform as a ring with spokes, through
// which one sees the pad. Bars of one colour are drawn together, however many thimbles there are.

const bar_shape = new THREE.CylinderBufferGeometry(1, 1, 1, 8).rotateX(Math.PI / 2);  // along z
const coarse_bar = new THREE.CylinderBufferGeometry(1, 1, 1, 5, 1, true).rotateX(Math.PI / 2);
const mechanism_colours = { frame: '#5c6b78', crank: '#e0871a', link: '#404d59', ring: '#2e9e45' };
for (const [part, color] of Object.entries(mechanism_colours))
  mechanism_colours[part] = new THREE.MeshLambertMaterial({ color });

const z_axis = new THREE.Vector3(0, 0, 1), no_bar = new THREE.Matrix4().makeScale(0, 0, 0);
/** So many bars of a material and shapes that no other drawing has: lay(k, a, b, radius) puts one from a to b [mm], hide(k) takes it away. */
function barsOf(material, count, shape = bar_shape, coarse = coarse_bar) {
  const shapes = [shape.clone(), coarse.clone()];
  const mesh = new THREE.InstancedMesh(shapes[0], material, Math.max(1, count)), matrix = new THREE.Matrix4();
  const axis = new THREE.Vector3(), middle = new THREE.Vector3(), turn = new THREE.Quaternion(), size = new THREE.Vector3();
  mesh.frustumCulled = false;
  mesh.visible = count > 0;
  const hide = k => mesh.setMatrixAt(k, no_bar);
  for (let k = 0; k < mesh.count; ++k) hide(k);
  function lay(k, a, b, radius) {
    const length = axis.copy(b).sub(a).length();
    mesh.instanceMatrix.needsUpdate = true;
    if (!(length > 1e-3)) return hide(k);
    turn.setFromUnitVectors(z_axis, axis.divideScalar(length));
    mesh.setMatrixAt(k, matrix.compose(middle.copy(a).add(b).multiplyScalar(0.5), turn, size.set(radius, radius, length)));
  }
  const fit = () => { mesh.geometry = shapes[detail.level > 0 ? 1 : 0]; };
  return { mesh, lay, fit, hide: k => { hide(k); mesh.instanceMatrix.needsUpdate = true; } };
}

/** The edge of a thimble's platform, z towards the pad. */
function rimOf(thimble, thickness) {
  return new THREE.Mesh(new THREE.TorusBufferGeometry(1e3 * thimble.radius, thickness, 5, 24), mechanism_colours.ring);
}

/** What a thimble's bars are: part, and from which point of which line. The first two lines of several are frames; the
    first part of any other of several parts is a crank, on its servo. */
function partsOf(thimble) {
  const { links } = thimble, parts = [];
  links.forEach((count, line) => {
    const is_frame = line < 2 && links.length > 2 && count > 2;
    for (let k = 0; k + 1 < count; ++k) {
      const part = is_frame ? 'frame' : count > 2 && k === 0 ? 'crank' : 'link';
      parts.push({ line, k, part, radius: { frame: 0.9, crank: 1, link: 0.6 }[part] });
      if (part === 'crank') parts.push({ line, k, part: 'frame', drum: true, radius: 2.1 });
    }
  });
  for (let k = 0; k < 3; ++k) parts.push({ spoke: 2 * Math.PI * k / 3, part: 'ring', radius: 0.3 });
  return parts;
}
/** The platforms' edges, all in one drawing. */
const thimble_rims = (() => {
  const { radius } = model.thimbles[0] || { radius: 0.01 };
  const mesh = new THREE.InstancedMesh(new THREE.TorusBufferGeometry(1, 8e-4 / radius, 5, 24), mechanism_colours.ring.clone(),
    Math.max(1, model.thimbles.length));
  mesh.frustumCulled = false;
  return mesh;
})();
/** All mechanisms: of each show(t, bone's matrix), which moves it to a thimble of a frame. */
const thimble_bars = {}, mechanisms = (() => {
  const all = model.thimbles.map(partsOf), used = {};
  for (const part of Object.keys(mechanism_colours))
    thimble_bars[part] = barsOf(mechanism_colours[part].clone(), all.flat().filter(one => one.part === part).length);
  return model.thimbles.map((thimble, i) => {
    const radius = 1e3 * thimble.radius, disk = new THREE.Object3D(), rim = new THREE.Matrix4(), size = new THREE.Vector3(radius, radius, radius), a = new THREE.Vector3(), b = new THREE.Vector3();
    const parts = all[i].map(part => ({ ...part, number: used[part.part] = (used[part.part] ?? -1) + 1 }));
    function show(t, bone) {
      const at = (to, line, k) => to.fromArray(t.links[line], 3 * k);
      place(disk, t.pose);
      disk.updateMatrix();
      thimble_rims.setMatrixAt(i, rim.multiplyMatrices(bone, disk.matrix).scale(size));
      thimble_rims.instanceMatrix.needsUpdate = true;
      for (const { line, k, part, number, radius: thick, drum, spoke } of parts) {
        if (spoke !== undefined) a.setFromMatrixPosition(disk.matrix), b.set(radius * Math.cos(spoke), radius * Math.sin(spoke), 0).applyMatrix4(disk.matrix);
        else at(a, line, k), at(b, line, k + 1);
        if (drum) {
          const across = b.clone().sub(a).cross(at(new THREE.Vector3(), line, k + 2).sub(b));
          if (!(across.length() > 1e-6)) { thimble_bars[part].hide(number); continue; }
          b.copy(a).add(across.setLength(2.6));
          a.sub(across);
        }
        thimble_bars[part].lay(number, a.applyMatrix4(bone), b.applyMatrix4(bone), thick);
      }
    }
    return { show };
  });
})();
