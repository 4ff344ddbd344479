'use strict';
// Skin as one sees it: smooth between the nodes of its mesh, coloured by a field that is continuous over it. The mesh
// itself is coarse, as the simulation's speed asks; only the picture is finer (Phong tessellation, Boubekeur & Alexa 2008).

const rows_per_face = 3, towards_tangents = 0.75;
/** Weights of a face's corners at the points of its lattice, and the small triangles between them. */
const lattice = (() => {
  const weights = [], triangles = [], number = {};
  for (let i = 0; i <= rows_per_face; ++i)
    for (let j = 0; i + j <= rows_per_face; ++j) {
      number[i + ',' + j] = weights.length;
      weights.push([1 - (i + j) / rows_per_face, i / rows_per_face, j / rows_per_face]);
    }
  const at = (i, j) => number[i + ',' + j];
  for (let i = 0; i < rows_per_face; ++i)
    for (let j = 0; i + j < rows_per_face; ++j) {
      triangles.push([at(i, j), at(i + 1, j), at(i, j + 1)]);
      if (i + j + 1 < rows_per_face) triangles.push([at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]);
    }
  return { weights, triangles };
})();

/** Unit normals of a coarse mesh, weighted by area. */
function normalsOf(position, triangles) {
  const normal = new Float32Array(position.length);
  for (let t = 0; t < triangles.length; t += 3) {
    const [a, b, c] = [3 * triangles[t], 3 * triangles[t + 1], 3 * triangles[t + 2]];
    const ux = position[b] - position[a], uy = position[b + 1] - position[a + 1], uz = position[b + 2] - position[a + 2];
    const vx = position[c] - position[a], vy = position[c + 1] - position[a + 1], vz = position[c + 2] - position[a + 2];
    const nx = uy * vz - uz * vy, ny = uz * vx - ux * vz, nz = ux * vy - uy * vx;
    for (const i of [a, b, c]) { normal[i] += nx; normal[i + 1] += ny; normal[i + 2] += nz; }
  }
  for (let i = 0; i < normal.length; i += 3) {
    const length = Math.hypot(normal[i], normal[i + 1], normal[i + 2]) || 1;
    for (let d = 0; d < 3; ++d) normal[i + d] /= length;
  }
  return normal;
}

/** Coloured by the attribute `value` and the uniforms most and limited: where that is 1, what lies beyond twice the scale is
    at a limit, and blue. */
function skinMaterial() {
  const material = new THREE.MeshLambertMaterial({ side: THREE.DoubleSide });
  material.scale = { most: { value: 1 }, limited: { value: 0 } };
  material.onBeforeCompile = shader => {
    Object.assign(shader.uniforms, material.scale, { ramp: { value: skin_colours.map(c => new THREE.Vector3(...c.map(x => x / 255))) } });
    shader.vertexShader = 'attribute float value; varying float shown;\n' +
      shader.vertexShader.replace('#include <begin_vertex>', '#include <begin_vertex>\nshown = value;');
    shader.fragmentShader = `uniform float most, limited; uniform vec3 ramp[${skin_colours.length}]; varying float shown;\n` +
      shader.fragmentShader.replace('#include <color_fragment>', `
        diffuseColor.rgb = ramp[0];
        for (int k = 0; k < ${skin_colours.length - 1}; ++k)
          diffuseColor.rgb = mix(diffuseColor.rgb, ramp[k + 1], clamp(${skin_colours.length - 1}.0 * shown / most - float(k), 0.0, 1.0));
        if (limited > 0.5 && shown > 2.0 * most) diffuseColor.rgb = vec3(0.12, 0.3, 0.85);`);
  };
  return material;
}

/** Skin of a finger; show(position [mm], value(node)) moves and colours it. */
function skinOf(finger) {
  const { triangles } = finger, faces = triangles.length / 3, per_face = lattice.weights.length;
  const geometry = new THREE.BufferGeometry(), count = faces * per_face;
  for (const [name, size] of [['position', 3], ['normal', 3], ['value', 1]])
    geometry.setAttribute(name, new THREE.BufferAttribute(new Float32Array(size * count), size));
  const index = [];
  for (let f = 0; f < faces; ++f)
    for (const t of lattice.triangles) for (const corner of t) index.push(f * per_face + corner);
  geometry.setIndex(index);
  const material = skinMaterial(), mesh = new THREE.Mesh(geometry, material);
  const lines = new THREE.BufferGeometry();
  lines.setAttribute('position', new THREE.BufferAttribute(new Float32Array(finger.rest), 3));
  lines.setIndex(triangles);
  const edges = new THREE.Mesh(lines, new THREE.MeshBasicMaterial(
    { color: '#000', wireframe: true, transparent: true, opacity: 0.25 }));
  edges.visible = false;
  mesh.frustumCulled = edges.frustumCulled = false;
  const group = new THREE.Group();
  group.add(mesh, edges);

  const at = geometry.attributes, weights = lattice.weights;
  function paint(attribute, value) {
    for (let f = 0, k = 0; f < faces; ++f) {
      const a = value(triangles[3 * f]), b = value(triangles[3 * f + 1]), c = value(triangles[3 * f + 2]);
      for (const w of weights) attribute.array[k++] = w[0] * a + w[1] * b + w[2] * c;
    }
    attribute.needsUpdate = true;
  }
  const linear = new Float32Array(3);
  function show(position, value) {
    const normal = normalsOf(position, triangles);
    for (let f = 0, k = 0; f < faces; ++f) {
      const corner = [3 * triangles[3 * f], 3 * triangles[3 * f + 1], 3 * triangles[3 * f + 2]];
      for (const w of weights) {
        for (let d = 0; d < 3; ++d) {
          linear[d] = 0;
          let n = 0;
          for (let c = 0; c < 3; ++c) {
            linear[d] += w[c] * position[corner[c] + d];
            n += w[c] * normal[corner[c] + d];
          }
          at.normal.array[k + d] = n;
        }
        let x = linear[0], y = linear[1], z = linear[2];
        for (let c = 0; c < 3; ++c) {
          const i = corner[c];
          const off = towards_tangents * w[c] * ((linear[0] - position[i]) * normal[i] + (linear[1] - position[i + 1]) *
            normal[i + 1] + (linear[2] - position[i + 2]) * normal[i + 2]);
          x -= off * normal[i]; y -= off * normal[i + 1]; z -= off * normal[i + 2];
        }
        at.position.array[k] = x; at.position.array[k + 1] = y; at.position.array[k + 2] = z;
        k += 3;
      }
    }
    at.position.needsUpdate = at.normal.needsUpdate = true;
    paint(at.value, value);
    if (!edges.visible) return;
    lines.attributes.position.array.set(position);
    lines.attributes.position.needsUpdate = true;
  }
  /** The same shape, coloured by another field. */
  function twin() {
    const other = new THREE.BufferGeometry(), values = new THREE.BufferAttribute(new Float32Array(count), 1);
    other.setAttribute('position', at.position);
    other.setAttribute('normal', at.normal);
    other.setAttribute('value', values);
    other.setIndex(geometry.index);
    const of_same_shape = new THREE.Mesh(other, skinMaterial());
    of_same_shape.frustumCulled = false;
    return { mesh: of_same_shape, scale: of_same_shape.material.scale, paint: value => paint(values, value) };
  }
  return { group, edges, show, twin, scale: material.scale };
}
