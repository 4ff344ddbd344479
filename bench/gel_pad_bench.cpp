// Pads as robotic tactile sensors have them: a slab of gel, 20 x 20 x 4 mm, 0.1 MPa, fixed at its back, into which a
// ball is pressed by 1 mm. Whole steps of one, a hundred and a thousand, and how far forces and skin are from a fine
// mesh's.

#include <benchmark/benchmark.h>

#include <cmath>
#include <map>

#include "bench/pressed_finger.h"
#include "engine/build.h"
#include "engine/step.h"
#include "meshes/mesh_quality.h"

namespace palpate {
namespace {

constexpr double width = 20e-3, height = 4e-3, radius = 5e-3, depth = 1e-3;  // [m]
constexpr double young = 100e3, poisson = 0.45;                              // [Pa]
constexpr int fine = 30, fine_layers = 6;

/// `cells` along each side and `layers` of them, each of six tetrahedra that share their change of volume; the back is
/// fixed, all of the front can touch.
TetMesh slab(int cells, int layers) {
    TetMesh m;
    const auto id = [&](int i, int j, int k) { return (i * (cells + 1) + j) * (layers + 1) + k; };
    for (int i = 0; i <= cells; ++i)
        for (int j = 0; j <= cells; ++j)
            for (int k = 0; k <= layers; ++k)
                m.nodes.push_back({width * (double(i) / cells - 0.5), width * (double(j) / cells - 0.5),
                                   height * (double(k) / layers)});
    // Kuhn's six: paths along the edges of a cell from its lowest corner to its highest; odd ones are mirrored.
    const int paths[6][2] = {{1, 2}, {2, 1}, {1, 4}, {4, 1}, {2, 4}, {4, 2}};
    for (int i = 0; i < cells; ++i)
        for (int j = 0; j < cells; ++j)
            for (int k = 0; k < layers; ++k) {
                const int patch = (i * cells + j) * layers + k;
                int corner[8];
                for (int b = 0; b < 8; ++b) corner[b] = id(i + (b & 1), j + ((b >> 1) & 1), k + ((b >> 2) & 1));
                for (const auto& [first, second] : paths) {
                    std::array<int, 4> t{corner[0], corner[first], corner[first | second], corner[7]};
                    const bool mirrored =
                        !((first == 1 && second == 2) || (first == 2 && second == 4) || (first == 4 && second == 1));
                    if (mirrored) std::swap(t[1], t[2]);
                    m.tets.push_back(t);
                    m.patches.push_back(patch);
                }
            }
    for (int i = 0; i <= cells; ++i)
        for (int j = 0; j <= cells; ++j) {
            m.bone_nodes.push_back(id(i, j, layers));
            m.pad_nodes.push_back(id(i, j, 0));
        }
    m.surface = boundary(m.tets);
    return m;
}

/// Pads above a ball each, which has its top where they begin.
World pads_over_balls(const TetMesh& mesh, int pads, int iterations, bool single_precision) {
    SceneSpec spec;
    spec.solver.dt = 1e-3;
    if (iterations > 0) {
        spec.solver.newton_iterations = iterations;
        spec.solver.tolerance = 1e-4, spec.solver.multiplier_tolerance = 1e-3;
    }
    FingerSpec f;
    f.mesh = mesh;
    f.young_modulus = young, f.poisson_ratio = poisson;
    f.single_precision = single_precision;
    f.coupling.stiffness = 1e6, f.coupling.angular_stiffness = 1e3;
    f.coupling.damping = 500, f.coupling.angular_damping = 0.5;
    spec.fingers.assign(std::size_t(pads), f);
    for (int i = 0; i < pads; ++i) spec.fingers[std::size_t(i)].name = "pad";
    spec.objects.push_back(
        {"ball", {ShapeKind::sphere, {radius, 0, 0}}, {{0, 0, -radius}, {1, 0, 0, 0}}, 0});  // no friction: one answer
    spec.fingers_touch = false;
    return build_world(spec);
}

constexpr int coming = 50, held = 50;  // steps

/// Presses all of the pads alike and holds them; the time of the steps [s].
double press(World& world, Threads& threads) {
    double seconds = 0;
    for (int k = 1; k <= coming + held; ++k) {
        const double z = -depth * std::min(1.0, double(k) / coming);
        for (std::size_t i = 0; i < world.tracker_poses.size(); ++i)
            world.tracker_poses[i].incoming = {{{0, 0, z}, Quaternion<double>::identity()}, 1e-3 * k, true};
        step(world, threads);
        seconds += world.profile.total();
    }
    return seconds;
}

/// The first pad once it is held: the force on it along the press [N], and its skin [m].
struct Pressed {
    double force = 0;
    std::vector<Vec3<double>> skin;  ///< [pad node]
};
Pressed outcome(const World& world) {
    const ContactSurface& c = world.contact_surfaces[0];
    return {c.total.z, c.position};
}

const Pressed& reference() {
    static const Pressed pressed = [] {
        World world = pads_over_balls(slab(fine, fine_layers), 1, 0, false);
        Threads threads(2);
        press(world, threads);
        return outcome(world);
    }();
    return pressed;
}

/// Mean error of the skin's height at the nodes that both meshes have, over the depth.
double skin_error(const Pressed& a, int cells) {
    const Pressed& b = reference();
    const int every = fine / cells;
    double off = 0;
    for (int i = 0; i <= cells; ++i)
        for (int j = 0; j <= cells; ++j)
            off += std::abs(a.skin[std::size_t(i * (cells + 1) + j)].z -
                            b.skin[std::size_t((every * i) * (fine + 1) + every * j)].z);
    return off / double((cells + 1) * (cells + 1)) / depth;
}

void gel_pad(benchmark::State& state) {
    const int cells = int(state.range(0)), layers = int(state.range(1)), pads = int(state.range(2)),
              iterations = int(state.range(3)), count = int(state.range(4));
    const TetMesh mesh = slab(cells, layers);
    Threads threads(count);
    double force = 0, error = 0;
    for (auto _ : state) {
        World world = pads_over_balls(mesh, pads, iterations, true);
        state.SetIterationTime(press(world, threads) / (coming + held));
        const Pressed pressed = outcome(world);
        force = pressed.force, error = skin_error(pressed, cells);
        state.counters["kB_per_pad"] = 1e-3 * double(skin_memory_bytes(world)) / pads;
    }
    state.counters["tetrahedra"] = double(mesh.tets.size());
    state.counters["pad_steps_per_s"] = benchmark::Counter(double(pads), benchmark::Counter::kIsIterationInvariantRate);
    state.counters["force_N"] = force;
    state.counters["force_error_%"] = 100 * std::abs(force / reference().force - 1);
    state.counters["skin_error_%"] = 100 * error;
}
BENCHMARK(gel_pad)
    ->ArgsProduct({{10}, {2}, {1, 100, 1000}, {1, 2}, {1, 2}})
    ->ArgsProduct({{10}, {2}, {1}, {0}, {1}})
    ->ArgsProduct({{15}, {3}, {1}, {0}, {1}})
    ->ArgsProduct({{15}, {3}, {1, 100}, {1, 2}, {1, 2}})
    ->ArgNames({"cells", "layers", "pads", "iterations", "threads"})
    ->Iterations(1)
    ->UseManualTime()
    ->Unit(benchmark::kMicrosecond);

}  // namespace
}  // namespace palpate
