'use strict';
// The shadow of what stands over a floor, soft, in light that comes almost from above, as in pictures: what casts it is
// drawn black from the light's side, and floors look it up.

const light_direction = new THREE.Vector3(0.16, -0.10, 1).normalize(), shadow_reach = 160;  // [mm]
const shadow_of_meshes = 1, shadow_of_bars = 2;  // layers
const shadow_camera = new THREE.OrthographicCamera(-shadow_reach, shadow_reach, shadow_reach, -shadow_reach, 1, 2000);
const shadow_cells = 256, [shadow_map, half_blurred] = [0, 1].map(() =>
  new THREE.WebGLRenderTarget(shadow_cells, shadow_cells, { minFilter: THREE.LinearFilter, magFilter: THREE.LinearFilter }));
const shadow_place = { value: new THREE.Matrix4() }, all_black = [0, 1].map(() =>
  new THREE.MeshBasicMaterial({ color: '#000000', side: THREE.DoubleSide }));

/** Softens the map, first along one side and then along the other. */
const soften = (() => {
  const material = new THREE.ShaderMaterial({
    uniforms: { map: { value: null }, along: { value: new THREE.Vector2() } },
    vertexShader: 'varying vec2 at; void main() { at = uv; gl_Position = vec4(position.xy, 0.0, 1.0); }',
    fragmentShader: `uniform sampler2D map; uniform vec2 along; varying vec2 at; void main() { float sum = 0.0;
      for (int k = -3; k <= 3; ++k) sum += (4.0 - abs(float(k))) * texture2D(map, at + float(k) * along).r;
      gl_FragColor = vec4(vec3(sum / 16.0), 1.0); }`, depthTest: false, depthWrite: false });
  const quad = new THREE.Scene(), flat_camera = new THREE.OrthographicCamera(-1, 1, 1, -1, 0, 1), off = 1.6 / shadow_cells;
  const square = new THREE.Mesh(new THREE.PlaneBufferGeometry(2, 2), material);
  square.frustumCulled = false;
  quad.add(square);
  return renderer => [[shadow_map, half_blurred, off, 0], [half_blurred, shadow_map, 0, off]].forEach(([from, to, x, y]) => {
    material.uniforms.map.value = from.texture;
    material.uniforms.along.value.set(x, y);
    renderer.setRenderTarget(to);
    renderer.render(quad, flat_camera);
  });
})();

function casts(mesh) { mesh.layers.enable(mesh.isInstancedMesh ? shadow_of_bars : shadow_of_meshes); }
/** Draws the shadow anew, around a place. */
function castShadow(renderer, scene, around) {
  shadow_camera.position.copy(around).addScaledVector(light_direction, 1000);
  shadow_camera.up.set(0, 1, 0);
  shadow_camera.lookAt(around);
  shadow_camera.updateMatrixWorld();
  shadow_place.value.multiplyMatrices(shadow_camera.projectionMatrix, shadow_camera.matrixWorldInverse);
  const { background } = scene, clear = renderer.getClearColor().clone();
  scene.background = null;
  renderer.setRenderTarget(shadow_map);
  renderer.setClearColor('#ffffff');
  renderer.clear();
  renderer.autoClear = false;
  [shadow_of_meshes, shadow_of_bars].forEach((layer, k) => {  // a material serves either bars or meshes
    shadow_camera.layers.set(layer);
    scene.overrideMaterial = all_black[k];
    renderer.render(scene, shadow_camera);
  });
  scene.overrideMaterial = null;
  scene.background = background;
  soften(renderer);
  renderer.autoClear = true;
  renderer.setClearColor(clear);
  renderer.setRenderTarget(null);
}
/** A material of what lies in that shadow. */
function inShadow(material) {
  material.onBeforeCompile = shader => {
    Object.assign(shader.uniforms, { shadow_map: { value: shadow_map.texture }, shadow_place });
    shader.vertexShader = 'uniform mat4 shadow_place; varying vec2 in_shadow;\n' + shader.vertexShader.replace('#include <project_vertex>',
      '#include <project_vertex>\nin_shadow = 0.5 + 0.5 * (shadow_place * modelMatrix * vec4(transformed, 1.0)).xy;');
    shader.fragmentShader = 'uniform sampler2D shadow_map; varying vec2 in_shadow;\n' + shader.fragmentShader.replace('#include <map_fragment>', `
      #include <map_fragment>
      float lit = texture2D(shadow_map, in_shadow).r;
      if (any(greaterThan(abs(in_shadow - 0.5), vec2(0.485)))) lit = 1.0;
      diffuseColor.rgb *= mix(0.58, 1.0, lit);`);
  };
  return material;
}
