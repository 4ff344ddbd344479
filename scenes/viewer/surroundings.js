'use strict';
// What fingers touch, and where: objects as clear glass of which one sees the nearest surface alone (no face is torn by
// another, whatever the shape), their edges, a ground to stand on, and names.

const object_colours = ['#5b93c5', '#5fa377', '#8f8bc7', '#4f9aa3', '#8d97a6', '#a39b4f'];  // unlike skin

function geometryOf(object) {
  const s = object.size.map(x => 1e3 * x);
  if (object.kind === 'plane') return new THREE.PlaneBufferGeometry(240, 240);
  if (object.kind === 'box') return new THREE.BoxBufferGeometry(2 * s[0], 2 * s[1], 2 * s[2]);
  if (object.kind === 'sphere') return new THREE.SphereBufferGeometry(s[0], 48, 32);
  if (object.kind === 'mesh') {
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

/** Drawn in three passes, after all that is opaque and the thimbles: depth, then colour where depth is the nearest. */
function objectOf(object, k) {
  const group = new THREE.Group(), geometry = geometryOf(object);
  if (object.kind === 'plane') {
    group.add(new THREE.Mesh(geometry, new THREE.MeshLambertMaterial(
      { color: '#dfe7ee', transparent: true, opacity: 0.25, side: THREE.DoubleSide, depthWrite: false })));
    group.add(groundGrid());
    return group;
  }
  const colour = object_colours[k % object_colours.length];
  const depth = new THREE.Mesh(geometry, new THREE.MeshBasicMaterial({ colorWrite: false, transparent: true }));
  const surface = new THREE.Mesh(geometry, new THREE.MeshLambertMaterial(
    { color: colour, transparent: true, opacity: 0.5, depthWrite: false }));
  const edges = new THREE.LineSegments(new THREE.EdgesGeometry(geometry, 35), new THREE.LineBasicMaterial(
    { color: new THREE.Color(colour).multiplyScalar(0.55), transparent: true, opacity: 0.7 }));
  depth.renderOrder = 1, surface.renderOrder = 2, edges.renderOrder = 3;
  group.add(depth, surface, edges);
  return group;
}

function groundGrid() {
  const grid = new THREE.GridHelper(240, 24, '#8d99a8', '#b9c3cf');
  grid.rotateX(Math.PI / 2);
  grid.material.transparent = true;
  grid.material.opacity = 0.45;
  return grid;
}
/** A ground below the objects of a scene that has no plane. */
function groundBelow(group) {
  const box = new THREE.Box3().setFromObject(group), grid = groundGrid();
  const middle = box.getCenter(new THREE.Vector3());
  grid.position.set(Math.round(middle.x / 10) * 10, Math.round(middle.y / 10) * 10, box.min.z);
  return grid;
}

/** A name that follows a place of the scene. */
function nameTag(text, colour) {
  const tag = document.createElement('div');
  tag.className = 'tag';
  tag.textContent = text;
  tag.style.color = colour;
  by('stage').append(tag);
  return (place, camera, width, height, shown) => {
    const at = place.clone().project(camera);
    tag.hidden = !shown || at.z > 1;
    tag.style.transform = `translate(-50%, -50%) translate(${(0.5 + at.x / 2) * width}px, ${(0.5 - at.y / 2) * height}px)`;
  };
}
