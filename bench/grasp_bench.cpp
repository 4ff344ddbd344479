// Fingers that hold a body: time per step, against the same fingers on a fixed object, and the error of the grip
// against the converged solve; distance queries of a mesh.

#include <benchmark/benchmark.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <random>

#include "bench/quantile.h"
#include "meshes/surface.h"
#include "scenes/run/summary.h"

namespace palpate {
namespace {

const std::string folder = PALPATE_SOURCE_DIR "/scenes/";

/// A grasp scene; `fixed`: its bodies cannot move, and the hand does not lift.
Simulation run_grasp(const std::string& name, std::vector<std::string> settings, bool fixed, double duration) {
    settings.push_back("dt_ms=1");
    Scene scene = load_scene(folder + name + ".toml", settings);
    if (duration > 0) scene.duration = duration;
    if (fixed)
        for (ObjectSpec& o : scene.spec.objects) o.body.reset();
    Simulation s = make_simulation(std::move(scene), 2);
    const std::atomic<bool> stop{false};
    run(s, stop, {});
    return s;
}

double mean_step(const Simulation& s) {
    double sum = 0;
    for (double us : s.step_series.column("total_us")) sum += us;
    return sum / double(s.step_series.rows());
}

void grasp(benchmark::State& state, const std::string& name, const std::vector<std::string>& settings) {
    static std::map<std::string, Simulation> references;
    std::vector<std::string> mesh;  // of the same fingers
    for (const std::string& s : settings)
        if (s.starts_with("mesh.")) mesh.push_back(s);
    const std::string key = name + (mesh.empty() ? "" : "/" + mesh[0]);
    if (!references.count(key)) references.emplace(key, run_grasp(name, mesh, false, 0));
    const Simulation& reference = references.at(key);
    for (auto _ : state) {
        const Simulation s = run_grasp(name, settings, false, 0);
        state.SetIterationTime(1e-6 * mean_step(s));
        state.counters["p99_us"] = quantile(s.step_series.column("total_us"), 0.99);
        double error = 0, total = 0;
        for (std::size_t f = 0; f < s.finger_series.size(); ++f)
            for (std::size_t r = 0; r < s.finger_series[f].rows(); ++r) {
                double squared = 0;
                for (std::size_t c = 2; c <= 4; ++c)
                    squared += std::pow(s.finger_series[f].at(r, c) - reference.finger_series[f].at(r, c), 2);
                error += std::sqrt(squared);
                total += reference.finger_series[f].at(r, 1);
            }
        state.counters["force_error_%"] = 100 * error / total;
        state.counters["drift_mm"] = summarise(s).bodies[0].drift_mm;
        // While the fingers close on it, before the lift; the least of several runs by turns.
        const double closing = 0.55;
        double held = 1e300, fixed = 1e300;
        for (int run = 0; run < 5; ++run) {
            held = std::min(held, mean_step(run_grasp(name, settings, false, closing)));
            fixed = std::min(fixed, mean_step(run_grasp(name, settings, true, closing)));
        }
        state.counters["times_fixed_object"] = held / fixed;
    }
}

#define PALPATE_GRASP(name, scene, ...)                                           \
    BENCHMARK_CAPTURE(grasp, name, #scene, std::vector<std::string>{__VA_ARGS__}) \
        ->Iterations(1)                                                           \
        ->UseManualTime()                                                         \
        ->Unit(benchmark::kMicrosecond)
PALPATE_GRASP(ball_five_fingers_1, hold_ball, "solver.preset=real-time", "solver.newton_iterations=1");
PALPATE_GRASP(ball_five_fingers_2, hold_ball, "solver.preset=real-time");
PALPATE_GRASP(mug_five_fingers_1, hold_mug, "solver.preset=real-time", "solver.newton_iterations=1");
PALPATE_GRASP(mug_five_fingers_2, hold_mug, "solver.preset=real-time");
PALPATE_GRASP(box_ten_fingers_1, two_hands, "solver.preset=real-time", "solver.newton_iterations=1");
PALPATE_GRASP(box_ten_fingers_2, two_hands, "solver.preset=real-time");
// Fingers of meshes as they were before those conformed to the bone, which do not touch each other: the same work as in
// older versions. And what it costs that they do.
#define PALPATE_OLDER "mesh.kind=uniform", "mesh.patch=0", "solver.preset=real-time"
PALPATE_GRASP(ball_five_uniform_1, hold_ball, PALPATE_OLDER, "solver.newton_iterations=1", "contact.fingers=false");
PALPATE_GRASP(ball_five_uniform_2, hold_ball, PALPATE_OLDER, "contact.fingers=false");
PALPATE_GRASP(mug_five_uniform_1, hold_mug, PALPATE_OLDER, "solver.newton_iterations=1", "contact.fingers=false");
PALPATE_GRASP(mug_five_uniform_2, hold_mug, PALPATE_OLDER, "contact.fingers=false");
PALPATE_GRASP(box_ten_uniform_1, two_hands, PALPATE_OLDER, "solver.newton_iterations=1", "contact.fingers=false");
PALPATE_GRASP(box_ten_uniform_2, two_hands, PALPATE_OLDER, "contact.fingers=false");
PALPATE_GRASP(mug_five_touching_1, hold_mug, PALPATE_OLDER, "solver.newton_iterations=1");
PALPATE_GRASP(mug_five_touching_2, hold_mug, PALPATE_OLDER);

/// Queries that walk along the surface, as contact's do; and at random places near it.
void mesh_query(benchmark::State& state, bool smooth, bool walk) {
    const DistanceMesh mesh = build_distance_mesh(read_surface(folder + "mug.obj", "mm").surface, smooth ? -1 : 0);
    std::mt19937 random(1);
    std::normal_distribution<double> normal(0, 1);
    std::vector<Vec3<double>> points;
    for (int i = 0; i < 200; ++i) {
        const DistanceMesh::Triangle* t = &mesh.triangles[random() % mesh.triangles.size()];
        for (int k = 0; k < 100; ++k) {
            if (!walk) t = &mesh.triangles[random() % mesh.triangles.size()];
            const double step = walk ? 2e-5 * k : 1e-3;
            points.push_back(t->corner + step * Vec3<double>{normal(random), normal(random), normal(random)});
        }
    }
    std::size_t next = 0;
    for (auto _ : state) {
        benchmark::DoNotOptimize(mesh_contact_distance(mesh, points[next]));
        if (++next == points.size()) next = 0;
    }
    state.counters["vertices"] = double(mesh.surface.vertices.size());
}
BENCHMARK_CAPTURE(mesh_query, smooth, true, true);
BENCHMARK_CAPTURE(mesh_query, exact_walk, false, true);
BENCHMARK_CAPTURE(mesh_query, exact_random, false, false);

}  // namespace
}  // namespace palpate
