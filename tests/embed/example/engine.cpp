// The smallest program that embeds the engine: one tetrahedron, one step.
#include <palpate/engine/build.h>
#include <palpate/engine/step.h>
#include <cstdio>

int main() {
    palpate::FingerSpec finger;
    finger.name = "tetrahedron";
    finger.mesh.nodes = {{0, 0, 0}, {0.01, 0, 0}, {0, 0.01, 0}, {0, 0, 0.01}};
    finger.mesh.tets = {{0, 1, 2, 3}};
    finger.mesh.bone_nodes = {1, 2, 3};
    finger.mesh.pad_nodes = {0};
    palpate::SceneSpec spec;
    spec.fingers.push_back(finger);
    palpate::World world = palpate::build_world(spec);
    palpate::Threads threads(1);
    palpate::step(world, threads);
    std::printf("%g\n", world.time);
    return world.time > 0 && palpate::skin_status(world, world.skins.owner(0)).converged ? 0 : 1;
}
