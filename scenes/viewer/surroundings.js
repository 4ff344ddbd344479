'use strict';
// What fingers touch, and where: objects, clear where they hide a contact, their edges, and a floor to stand on.

const object_colours = ['#5b93c5', '#5fa377', '#8f8bc7', '#4f9aa3', '#8d97a6', '#a39b4f'];  // unlike skin

function geometryOf(object) {
  const s = object.size.map(x => 1e3 * x);
  const parts = object.gives_way ? 24 : 1;  // small enough for a dent
  if (object.kind === 'box') return new THREE.BoxBufferGeometry(2 * s[0], 2 * s[1], 2 * s[2], parts, parts, parts);
  if (object.kind === 'sphere') return new THREE.SphereBufferGeometry(s[0], 48, 32);
  if (object.kind === 'mesh' || object.kind === 'soft') {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute('position', new THREE.BufferAttribute(new Float32Array(object.vertices.map(x => 1e3 * x)), 3));
    geometry.setIndex(object.triangles);
    geometry.computeVertexNormals();
    if (object.kind === 'soft') return geometry.toNonIndexed();
    return geometry;
  }
  const middle = new THREE.CylinderGeometry(s[0], s[0], 2 * s[1], 48).rotateX(Math.PI / 2);
  if (object.kind === 'capsule')
    for (const side of [-1, 1]) middle.merge(new THREE.SphereGeometry(s[0], 48, 24).translate(0, 0, side * s[1]));
  return middle;
}

/** Contacts that nothing may hide, in view space, as a way from the eye and how far: what lies before one is clear around it. */
const most_contacts = 24, clear_radius = 11;
const contacts_in_view = { value: Array.from({ length: most_contacts }, () => new THREE.Vector4()) }, contact_count = { value: 0 };
/** Of contacts, those whose pads face the eye: the others are behind their own fingers. */
function showContacts(contacts, camera) {
  const seen = contacts.filter(({ at, force }) =>
    force.dot(camera.position.clone().sub(at).normalize()) < 0.25 * force.length()).slice(0, most_contacts);
  contact_count.value = seen.length;
  seen.forEach(({ at }, k) => {
    const there = at.clone().applyMatrix4(camera.matrixWorldInverse), far = there.length();
    contacts_in_view.value[k].set(there.x / far, there.y / far, there.z / far, far);
  });
}
function clearBeforeContacts(shader) {
  Object.assign(shader.uniforms, { contacts: contacts_in_view, contact_count });
  shader.vertexShader = 'varying vec3 in_view;\n' +
    shader.vertexShader.replace('#include <project_vertex>', '#include <project_vertex>\nin_view = mvPosition.xyz;');
  const [inner, outer] = [0.65 * clear_radius, clear_radius].map(r => (r * r).toFixed(2));
  shader.fragmentShader = `uniform vec4 contacts[${most_contacts}]; uniform int contact_count; varying vec3 in_view;\n` +
    shader.fragmentShader.replace('#include <tonemapping_fragment>', `
      float clear = 0.0, far = dot(in_view, in_view);
      for (int k = 0; k < ${most_contacts}; ++k) {
        if (k >= contact_count) break;
        float along = dot(in_view, contacts[k].xyz);
        if (along < contacts[k].w - 0.5) clear = max(clear, 1.0 - smoothstep(${inner}, ${outer}, far - along * along));
      }
      gl_FragColor.a *= 1.0 - 0.8 * clear;
      #include <tonemapping_fragment>`);
}

/** The surface nearest to the eye, whatever the shape: no face is torn by another. Drawn after all that is opaque: depth,
    then colour where depth is the nearest. */
function nearestSurface(geometry, colour, opacity) {
  const group = new THREE.Group();
  const depth = new THREE.Mesh(geometry, new THREE.MeshBasicMaterial(
    { colorWrite: false, transparent: true, polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 2 }));
  const material = new THREE.MeshLambertMaterial({ color: colour, transparent: true, opacity, depthWrite: false });
  material.onBeforeCompile = clearBeforeContacts;
  const surface = new THREE.Mesh(geometry, material);
  depth.renderOrder = 1, surface.renderOrder = 2;
  group.add(depth, surface);
  return group;
}

/** A surface that is opaque but where it hides a contact, in one drawing: what lies behind it there is not its own. */
function clearedSurface(geometry, colour) {
  const material = new THREE.MeshLambertMaterial({ color: colour, transparent: true });
  material.onBeforeCompile = clearBeforeContacts;
  const surface = new THREE.Mesh(geometry, material);
  surface.renderOrder = 1;
  return surface;
}

function objectOf(object, k) {
  const colour = object_colours[k % object_colours.length];
  if (object.kind === 'plane') return planeOf(colour);
  const geometry = geometryOf(object), group = nearestSurface(geometry, colour, 0.93);
  const edges = new THREE.LineSegments(new THREE.EdgesGeometry(geometry, object.kind === 'mesh' ? 60 : 35), new THREE.LineBasicMaterial(
    { color: new THREE.Color(colour).multiplyScalar(0.55), transparent: true, opacity: 0.7 }));
  edges.renderOrder = 3;
  if (object.kind === 'soft') group.dent = dentOf(geometry, group.children[1].material, new THREE.Color(colour), object.triangles);
  else group.add(edges);  // of tissue they would stay where they were
  if (object.gives_way) group.give = giveOf(geometry);
  return group;
}
/** What puts the surface of an object of tissue where it is, in the colours of what presses on it. */
function dentOf(geometry, material, own, triangles) {
  geometry.setAttribute('color', new THREE.BufferAttribute(new Float32Array(geometry.attributes.position.array.length), 3));
  material.color.set('#ffffff'), material.vertexColors = THREE.VertexColors;
  const { position, normal, color } = geometry.attributes, flat = new THREE.Vector3(), smooth = new THREE.Vector3();
  const [a, b, c] = [0, 1, 2].map(() => new THREE.Vector3());
  return at => {
    const normals = normalsOf(at.position, triangles), shown = Array.from(at.pressure, pressure => {
      const share = pressure / quantities.pressure.most, pressed = skinColour(share), mix = Math.min(1, 4 * share);
      return [own.r, own.g, own.b].map((c, d) => c + mix * (pressed[d] - c));
    });
    for (let t = 0; t < triangles.length; t += 3) {
      [a, b, c].forEach((x, k) => x.fromArray(at.position, 3 * triangles[t + k]));
      flat.copy(b).sub(a).cross(c.sub(a)).normalize();
      for (let k = 0; k < 3; ++k) {
        const node = triangles[t + k], place = 3 * (t + k);
        smooth.fromArray(normals, 3 * node);
        (smooth.dot(flat) > 0.8 ? smooth : flat).toArray(normal.array, place);  // across an edge they are not shared
        for (let d = 0; d < 3; ++d) position.array[place + d] = at.position[3 * node + d], color.array[place + d] = shown[node][d];
      }
    }
    position.needsUpdate = normal.needsUpdate = color.needsUpdate = true;
    geometry.computeBoundingSphere();
  };
}

/** What lets the surface of an object that gives way follow the skin that is pressed into it: points of skin that touch,
    in the object's frame [mm]. Each vertex goes inwards, against its normal, to skin nearby that lies deeper. */
function giveOf(geometry) {
  const rest = geometry.attributes.position.array.slice(), normal = geometry.attributes.normal.array.slice();
  let dented = false;
  return skin => {
    const place = geometry.attributes.position;
    if (skin.length === 0 && !dented) return;
    dented = skin.length > 0;
    for (let i = 0; i < rest.length; i += 3) {
      let deepest = 0;
      for (const x of skin) {
        const wx = x.x - rest[i], wy = x.y - rest[i + 1], wz = x.z - rest[i + 2];
        const depth = -(wx * normal[i] + wy * normal[i + 1] + wz * normal[i + 2]);
        if (depth > deepest) deepest = Math.max(deepest, depth * Math.exp(-0.125 * (wx * wx + wy * wy + wz * wz - depth * depth)));
      }
      for (let d = 0; d < 3; ++d) place.array[i + d] = rest[i + d] - deepest * normal[i + d];
    }
    place.needsUpdate = true;
    geometry.computeVertexNormals();
  };
}

/** A floor with a grid of 10 mm that ends softly; from below one sees through it. */
const floor_size = 480;  // [mm]
const floor_texture = (() => {
  const canvas = Object.assign(document.createElement('canvas'), { width: 1024, height: 1024 }), g = canvas.getContext('2d');
  g.fillStyle = dark ? '#2b323c' : '#e6e9ef';
  g.fillRect(0, 0, 1024, 1024);
  g.strokeStyle = dark ? '#4a5463' : '#bdc7d4';
  for (let mm = 0; mm <= floor_size; mm += 10) {
    const at = 1024 * mm / floor_size;
    g.lineWidth = mm % 50 ? 0.8 : 1.6;
    for (const [x0, y0, x1, y1] of [[at, 0, at, 1024], [0, at, 1024, at]]) {
      g.beginPath();
      g.moveTo(x0, y0);
      g.lineTo(x1, y1);
      g.stroke();
    }
  }
  g.globalCompositeOperation = 'destination-in';
  const soft = g.createRadialGradient(512, 512, 200, 512, 512, 512);
  soft.addColorStop(0, 'rgba(0,0,0,1)');
  soft.addColorStop(1, 'rgba(0,0,0,0)');
  g.fillStyle = soft;
  g.fillRect(0, 0, 1024, 1024);
  return new THREE.CanvasTexture(canvas);
})();
function floorOf() {
  const floor = new THREE.Group(), shape = new THREE.PlaneBufferGeometry(floor_size, floor_size);
  for (const [side, opacity] of [[THREE.FrontSide, 1], [THREE.BackSide, 0.18]])
    floor.add(new THREE.Mesh(shape, inShadow(new THREE.MeshBasicMaterial({ map: floor_texture, transparent: true, opacity, side, depthWrite: false }))));
  return floor;
}
/** A plane is a floor while it lies level, and glass else; settle() looks. */
function planeOf(colour) {
  const group = new THREE.Group(), level = floorOf();
  const tilted = new THREE.Mesh(new THREE.PlaneBufferGeometry(60, 60), new THREE.MeshLambertMaterial(
    { color: colour, transparent: true, opacity: 0.5, side: THREE.DoubleSide, depthWrite: false }));
  group.add(level, tilted);
  group.settle = () => {
    level.visible = new THREE.Vector3(0, 0, 1).applyQuaternion(group.quaternion).z > 0.999;
    tilted.visible = !level.visible;
  };
  return group;
}
/** A floor below the objects of a scene that has none. */
function groundBelow(objects) {
  const box = new THREE.Box3(), floor = floorOf();
  for (const object of objects) {
    const { geometry } = object.children[0];
    geometry.computeBoundingBox();
    object.updateMatrixWorld();
    box.union(geometry.boundingBox.clone().applyMatrix4(object.matrixWorld));
  }
  const middle = box.getCenter(new THREE.Vector3());
  floor.position.set(Math.round(middle.x / 10) * 10, Math.round(middle.y / 10) * 10, box.min.z);
  return floor;
}
