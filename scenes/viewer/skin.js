'use strict';
// Skin as one sees it: smooth between the nodes of its mesh, coloured by a field that is continuous over it. The mesh
// itself is coarse, as the simulation's speed asks; only the picture is finer (Phong tessellation, Boubekeur & Alexa 2008).

const towards_tangents = 0.75;
/** Points between the nodes of a mesh, so many rows of small triangles in each face, those on an edge shared: each point's
    three corners (the places of their coordinates) and weights, and the small triangles. */
function latticeOf(triangles, rows) {
  const number = new Map(), corners = [], weights = [], index = [];
  function point(face, i, j) {
    const parts = [[triangles[face], rows - i - j], [triangles[face + 1], i], [triangles[face + 2], j]];
    const key = parts.filter(part => part[1] > 0).sort((a, b) => a[0] - b[0]).join();
    if (!number.has(key)) {
      number.set(key, corners.length / 3);
      for (const [node, weight] of parts) corners.push(3 * node), weights.push(weight / rows);
    }
    return number.get(key);
  }
  for (let face = 0; face < triangles.length; face += 3)
    for (let i = 0; i < rows; ++i)
      for (let j = 0; i + j < rows; ++j) {
        index.push(point(face, i, j), point(face, i + 1, j), point(face, i, j + 1));
        if (i + j + 1 < rows) index.push(point(face, i + 1, j), point(face, i + 1, j + 1), point(face, i, j + 1));
      }
  return { count: corners.length / 3, corners: Int32Array.from(corners), weights: Float32Array.from(weights), index };
}
/** The smooth surface over a mesh's triangles: move(position, normal) of its nodes, mix(values of nodes, of points). */
function surfaceOf(triangles, rows) {
  const { count, corners, weights, index } = latticeOf(triangles, rows), order = new THREE.BufferGeometry();
  order.setIndex(index);
  const attribute = () => new THREE.BufferAttribute(new Float32Array(3 * count), 3), position = attribute(), normal = attribute();
  function move(x, n) {
    for (let k = 0; k < 3 * count; k += 3) {
      const a = corners[k], b = corners[k + 1], c = corners[k + 2], u = weights[k], v = weights[k + 1], w = weights[k + 2];
      const px = u * x[a] + v * x[b] + w * x[c], py = u * x[a + 1] + v * x[b + 1] + w * x[c + 1],
        pz = u * x[a + 2] + v * x[b + 2] + w * x[c + 2];
      normal.array[k] = u * n[a] + v * n[b] + w * n[c];
      normal.array[k + 1] = u * n[a + 1] + v * n[b + 1] + w * n[c + 1];
      normal.array[k + 2] = u * n[a + 2] + v * n[b + 2] + w * n[c + 2];
      const off = i => towards_tangents * ((px - x[i]) * n[i] + (py - x[i + 1]) * n[i + 1] + (pz - x[i + 2]) * n[i + 2]);
      const oa = u * off(a), ob = v * off(b), oc = w * off(c);
      position.array[k] = px - oa * n[a] - ob * n[b] - oc * n[c];
      position.array[k + 1] = py - oa * n[a + 1] - ob * n[b + 1] - oc * n[c + 1];
      position.array[k + 2] = pz - oa * n[a + 2] - ob * n[b + 2] - oc * n[c + 2];
    }
    position.needsUpdate = normal.needsUpdate = true;
  }
  function mix(from, to) {
    for (let k = 0, at = 0; at < count; k += 3)
      to[at++] = weights[k] * from[corners[k] / 3] + weights[k + 1] * from[corners[k + 1] / 3] + weights[k + 2] * from[corners[k + 2] / 3];
  }
  return { count, index: order.index, position, normal, move, mix };
}

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
  const material = new THREE.MeshLambertMaterial();
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

/** Skin of a finger: move(position [mm]) puts it there in its bone's frame, as finely as is asked for then; show(position,
    value(node)) also colours its own mesh. */
function skinOf(finger) {
  const { triangles } = finger, nodes = new Float32Array(finger.rest.length / 3), surfaces = {};
  let surface = null;
  /** The same shape once more, coloured by a field of its own. */
  function twin() {
    const material = skinMaterial(), mesh = new THREE.Mesh(new THREE.BufferGeometry(), material), shapes = new Map();
    mesh.frustumCulled = false;
    function shapeOf() {
      const shape = new THREE.BufferGeometry();
      shape.setIndex(surface.index);
      shape.setAttribute('position', surface.position);
      shape.setAttribute('normal', surface.normal);
      shape.setAttribute('value', new THREE.BufferAttribute(new Float32Array(surface.count), 1));
      return shape;
    }
    function paint(value) {
      if (!surface) return;
      if (!shapes.has(surface)) shapes.set(surface, shapeOf());
      mesh.geometry = shapes.get(surface);
      for (let i = 0; i < nodes.length; ++i) nodes[i] = value(i);
      const { value: shown } = mesh.geometry.attributes;
      surface.mix(nodes, shown.array);
      shown.needsUpdate = true;
    }
    return { mesh, scale: material.scale, paint };
  }
  const coat = twin(), lines = new THREE.BufferGeometry();
  lines.setAttribute('position', new THREE.BufferAttribute(new Float32Array(finger.rest), 3));
  lines.setIndex(triangles);
  const edges = new THREE.Mesh(lines, new THREE.MeshBasicMaterial(
    { color: '#000', wireframe: true, transparent: true, opacity: 0.25 }));
  edges.visible = edges.frustumCulled = false;
  const group = new THREE.Group();
  group.add(coat.mesh, edges);
  const surfaceAt = rows => surfaces[rows] || (surfaces[rows] = surfaceOf(triangles, rows));
  function move(position) {
    surface = surfaceAt(detail.rows);
    surface.move(position, normalsOf(position, triangles));
    if (!edges.visible) return;
    lines.attributes.position.array.set(position);
    lines.attributes.position.needsUpdate = true;
  }
  return { group, edges, move, show: (position, value) => { move(position); coat.paint(value); }, twin, surfaceAt, nodes, mesh: coat.mesh, scale: coat.scale };
}

/** The skins of all fingers in one drawing, in the world: put(k, bone's matrix, value(node)) takes one from where move() has
    put it. */
function coatOf(skins) {
  const material = skinMaterial(), mesh = new THREE.Mesh(new THREE.BufferGeometry(), material), shapes = {};
  mesh.frustumCulled = false;
  function shapeAt(rows) {
    const surfaces = skins.map(skin => skin.surfaceAt(rows)), first = [], index = [], geometry = new THREE.BufferGeometry();
    let count = 0;
    for (const surface of surfaces) {
      first.push(count);
      for (const i of surface.index.array) index.push(count + i);
      count += surface.count;
    }
    geometry.setIndex(index);
    for (const [name, size] of [['position', 3], ['normal', 3], ['value', 1]])
      geometry.setAttribute(name, new THREE.BufferAttribute(new Float32Array(size * count), size));
    return { surfaces, first, geometry };
  }
  function put(k, { elements: m }, value) {
    const { surfaces, first, geometry } = shapes[detail.rows] || (shapes[detail.rows] = shapeAt(detail.rows));
    const { count, position: { array: x }, normal: { array: n }, mix } = surfaces[k], { position, normal, value: shown } = geometry.attributes;
    for (let i = 0, to = 3 * first[k]; i < 3 * count; i += 3, to += 3)
      for (let d = 0; d < 3; ++d) {
        position.array[to + d] = m[d] * x[i] + m[d + 4] * x[i + 1] + m[d + 8] * x[i + 2] + m[d + 12];
        normal.array[to + d] = m[d] * n[i] + m[d + 4] * n[i + 1] + m[d + 8] * n[i + 2];
      }
    const { nodes } = skins[k];
    for (let i = 0; i < nodes.length; ++i) nodes[i] = value(i);
    mix(nodes, shown.array.subarray(first[k], first[k] + count));
    position.needsUpdate = normal.needsUpdate = shown.needsUpdate = true;
    mesh.geometry = geometry;
  }
  return { mesh, scale: material.scale, put };
}
