'use strict';
// What fingers touch, and where: objects, clear where they hide a contact, their edges, and a floor to stand on.

const object_colours = ['#5b93c5', '#5fa377', '#8f8bc7', '#4f9aa3', '#8d97a6', '#a39b4f'];  // unlike skin

function geometryOf(object) {
  const s = object.size.map(x => 1e3 * x);
  if (object.kind === 'box') return new THREE.BoxBufferGeometry(2 * s[0], 2 * s[1], 2 * s[2]);
  if (object.kind === 'sphere') return new THREE.SphereBufferGeometry(s[0], 48, 32);
  if (object.kind === 'mesh' || object.kind === 'soft') {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute('position', new THREE.BufferAttribute(new Float32Array(object.vertices.map(x => 1e3 * x)), 3));
    geometry.setIndex(object.triangles);
    geometry.computeVertexNormals();
    return geometry;
  }
  const middle = new THREE.CylinderGeometry(s[0], s[0], 2 * s[1], 48).rotateX(Math.PI / 2);
  if (object.kind === 'capsule')
    for (const side of [-1, 1]) middle.merge(new THREE.SphereGeometry(s[0], 48, 24).translate(0, 0, side * s[1]));
  return middle;
}

/** Contacts that nothing may hide, in view space: what lies between them and the eye is clear around them. */
const most_contacts = 24, clear_radius = 11;
const contacts_in_view = { value: Array.from({ length: most_contacts }, () => new THREE.Vector3()) }, contact_count = { value: 0 };
/** Of contacts, those whose pads face the eye: the others are behind their own fingers. */
function showContacts(contacts, camera) {
  const seen = contacts.filter(({ at, force }) =>
    force.dot(camera.position.clone().sub(at).normalize()) < 0.25 * force.length()).slice(0, most_contacts);
  contact_count.value = seen.length;
  seen.forEach(({ at }, k) => contacts_in_view.value[k].copy(at).applyMatrix4(camera.matrixWorldInverse));
}
function clearBeforeContacts(shader) {
  Object.assign(shader.uniforms, { contacts: contacts_in_view, contact_count });
  shader.vertexShader = 'varying vec3 in_view;\n' +
    shader.vertexShader.replace('#include <project_vertex>', '#include <project_vertex>\nin_view = mvPosition.xyz;');
  shader.fragmentShader = `uniform vec3 contacts[${most_contacts}]; uniform int contact_count; varying vec3 in_view;\n` +
    shader.fragmentShader.replace('#include <tonemapping_fragment>', `
      float clear = 0.0;
      for (int k = 0; k < ${most_contacts}; ++k) {
        if (k >= contact_count) break;
        vec3 along = normalize(contacts[k]), way = in_view - contacts[k];
        if (dot(along, way) > -0.5) continue;
        clear = max(clear, 1.0 - smoothstep(${(0.65 * clear_radius).toFixed(2)}, ${clear_radius.toFixed(2)}, length(way - dot(along, way) * along)));
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

function objectOf(object, k) {
  const colour = object_colours[k % object_colours.length];
  if (object.kind === 'plane') return planeOf(colour);
  const geometry = geometryOf(object), group = nearestSurface(geometry, colour, 0.93);
  const edges = new THREE.LineSegments(new THREE.EdgesGeometry(geometry, object.kind === 'mesh' ? 60 : 35), new THREE.LineBasicMaterial(
    { color: new THREE.Color(colour).multiplyScalar(0.55), transparent: true, opacity: 0.7 }));
  edges.renderOrder = 3;
  if (object.kind === 'soft') group.dent = dentOf(geometry, group.children[1].material, new THREE.Color(colour));
  else group.add(edges);  // of tissue they would stay where they were
  return group;
}
/** What puts the surface of an object of tissue where it is, in the colours of what presses on it. */
function dentOf(geometry, material, own) {
  geometry.setAttribute('color', new THREE.BufferAttribute(new Float32Array(geometry.attributes.position.array.length), 3));
  material.color.set('#ffffff'), material.vertexColors = THREE.VertexColors;
  return at => {
    geometry.attributes.position.array.set(at.position);
    const shown = geometry.attributes.color.array;
    for (let i = 0; i < at.pressure.length; ++i) {
      const share = at.pressure[i] / quantities.pressure.most, pressed = skinColour(share), mix = Math.min(1, 4 * share);
      [own.r, own.g, own.b].forEach((c, d) => { shown[3 * i + d] = c + mix * (pressed[d] - c); });
    }
    geometry.attributes.position.needsUpdate = geometry.attributes.color.needsUpdate = true;
    geometry.computeVertexNormals();
    geometry.computeBoundingSphere();
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
    floor.add(new THREE.Mesh(shape, new THREE.MeshBasicMaterial({ map: floor_texture, transparent: true, opacity, side, depthWrite: false })));
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
