// The skin solver against its goals: a finger pressed 2.5 mm in 0.25 s on a plane, E = 30 kPa, Poisson 0.45,
// limits 0.6 / 1.4, friction 0.5, dt = 1 ms. Times are medians over the steps of a press; each is also given in
// units of T0, the time of one elastic step of one finger written plainly with Eigen, and of B0, of one of eight in a
// register, both measured beside it.

#include <benchmark/benchmark.h>

#include <cmath>
#include <map>

#include "bench/batched_baseline.h"
#include "bench/batched_kernel.h"
#include "bench/eigen_baseline.h"
#include "bench/field_error.h"
#include "bench/pressed_finger.h"
#include "bench/quantile.h"
#include "engine/build.h"
#include "engine/skin/solve/kernels.h"
#include "engine/skin/solve/solve_skin.h"
#include "engine/step.h"

namespace palpate {
namespace {

const TetMesh& finger_of(int elements) {
    static std::map<int, TetMesh> meshes;
    const auto found = meshes.find(elements);
    if (found != meshes.end()) return found->second;
    return meshes[elements] = index_finger_mesh(elements);
}

constexpr int case_a = 347, case_b = 4000;

struct Press {
    std::vector<int> elements;  ///< mesh of each finger
    int iterations = 1;         ///< Newton iterations in a step; 0 = converged reference
    int threads = 1;
    bool limits = true, friction = true;
    double dt = 1e-3;
    int stiffness_steps = 16;  ///< 1: no matrix is kept
};

/// Height of finger i's target: from just above the plane 2.5 mm down; no two of eight fingers do the same.
double start_height(const Press& press, std::size_t i, double progress) {
    return 2e-5 * double(1 + i % 8) + touching_height(finger_of(press.elements[i])) - 2.5e-3 * progress;
}

SceneSpec scene_of(const Press& press, bool single_precision) {
    SceneSpec spec;
    spec.solver.dt = press.dt;
    if (press.iterations > 0) {  // as preset = "real-time"
        spec.solver.newton_iterations = press.iterations;
        spec.solver.stiffness_steps = press.stiffness_steps;
        spec.solver.tolerance = 1e-4;
        spec.solver.multiplier_tolerance = 1e-3;
    }
    for (std::size_t i = 0; i < press.elements.size(); ++i) {
        FingerSpec f;
        f.name = "finger";
        f.mesh = finger_of(press.elements[i]);
        f.has_limits = press.limits;
        f.single_precision = single_precision;
        f.start.position.z = start_height(press, i, 0);
        spec.fingers.push_back(f);
    }
    spec.objects.push_back({"table", {}, Pose<double>::identity(), press.friction ? 0.5 : 0});
    return spec;
}

struct Outcome {
    std::vector<double> step_us;  ///< the skin solve
    ForceFields forces;           ///< [step][finger and sample]
    double bytes_per_finger = 0;
};

template <class T>
Outcome run_press(const Press& press) {
    World world = build_world(scene_of(press, sizeof(T) == 4));
    Threads threads(press.threads);
    Outcome out;
    const int steps = press.elements[0] > case_b ? 60 : int(std::lround(0.25 / press.dt));
    for (int step = 1; step <= steps; ++step) {
        for (std::size_t i = 0; i < press.elements.size(); ++i) {
            const double z = start_height(press, i, double(step) / steps);
            world.tracker_poses[i].incoming = {{{0, 0, z}, Quaternion<double>::identity()}, step * press.dt, true};
        }
        palpate::step(world, threads);
        out.step_us.push_back(1e6 * world.profile.solve_skin);
        auto& row = out.forces.emplace_back();
        for (const ContactSurface& c : world.contact_surfaces) row.insert(row.end(), c.force.begin(), c.force.end());
    }
    out.bytes_per_finger = double(skin_memory_bytes(world)) / double(press.elements.size());
    return out;
}

template <class T>
void solver(benchmark::State& state, Press press) {
    static std::map<std::pair<std::vector<int>, int>, Outcome> references;
    // More fingers repeat what eight do; a converged reference of a large mesh would take minutes.
    const bool compare = press.elements.size() <= 8 && press.elements[0] <= case_b;
    const auto key = std::make_pair(press.elements, 2 * press.limits + press.friction);
    if (compare && !references.count(key)) {
        Press converged = press;
        converged.iterations = 0;
        references[key] = run_press<double>(converged);
    }
    Outcome out;
    for (auto _ : state) {
        out = run_press<T>(press);
        state.SetIterationTime(1e-6 * quantile(out.step_us, 0.5));
    }
    // The yardstick is measured anew beside every case: a machine's clock is not the same all day.
    const EigenBaseline T0 = time_eigen_baseline(finger_of(case_a));
    const double median = quantile(out.step_us, 0.5);
    state.counters["T0s"] = median / T0.all_nodes_us;
    state.counters["T0s_fixed_bone"] = median / T0.free_nodes_us;
    const double per_finger = median / double(press.elements.size());
    state.counters["us_per_finger"] = per_finger;
    state.counters["B0s_per_finger"] = per_finger / time_batched_baseline(finger_of(case_a)).us_per_finger;
    const int count = int(press.elements.size());
    state.SetLabel(std::string(best_kernels().instructions) + ", lanes: " + std::to_string(chunk_width<T>(count)));
    state.counters["p99_us"] = quantile(out.step_us, 0.99);
    state.counters["kB_per_finger"] = 1e-3 * out.bytes_per_finger;
    if (!compare) return;
    const FieldError error = field_error(out.forces, references[key].forces, 1e-6);
    state.counters["field_error_%"] = 100 * error.field;
    state.counters["total_error_%"] = 100 * error.total;
}

void eigen_T0(benchmark::State& state) {
    for (auto _ : state) {
        const EigenBaseline t = time_eigen_baseline(finger_of(case_a));
        state.SetIterationTime(1e-6 * t.all_nodes_us);
        state.counters["fixed_bone_us"] = t.free_nodes_us;
    }
    state.SetLabel(best_kernels().instructions);
    state.counters["double_lanes"] = chunk_width<double>(64);
    state.counters["float_lanes"] = chunk_width<float>(64);
}
BENCHMARK(eigen_T0)->Iterations(5)->UseManualTime()->Unit(benchmark::kMicrosecond);

void batched_B0(benchmark::State& state) {
    for (auto _ : state) {
        const BatchedBaseline b = time_batched_baseline(finger_of(case_a));
        if (!(b.solve_residual < 1e-3)) state.SkipWithError("its linear solve is wrong");
        state.SetIterationTime(1e-6 * b.us_per_finger);
        state.counters["elements"] = b.elements;
        state.counters["free_nodes"] = b.free_nodes;
        state.counters["solve_residual"] = b.solve_residual;
    }
    state.SetLabel(batched_instructions());
}
BENCHMARK(batched_B0)->Iterations(5)->UseManualTime()->Unit(benchmark::kMicrosecond);

std::vector<int> fingers(int count, int elements) { return std::vector<int>(std::size_t(count), elements); }
const std::vector<int> five_topologies{330, 338, 347, 356, 365};

template <class T>
void add(const std::string& name, const Press& press) {
    benchmark::RegisterBenchmark((name + (sizeof(T) == 8 ? "/double" : "/float")).c_str(),
                                 [press](benchmark::State& state) { solver<T>(state, press); })
        ->Iterations(3)
        ->UseManualTime()
        ->Unit(benchmark::kMicrosecond);
}

const bool registered = [] {
    auto both = [](const std::string& name, Press press) {
        add<double>(name, press);
        add<float>(name, press);
        press.stiffness_steps = 1;
        add<double>(name + "/none_kept", press);
        add<float>(name + "/none_kept", press);
    };
    both("goal_1/five_elastic/its_1", {fingers(5, case_a), 1, 1, false, false});
    for (int its : {1, 2, 3}) both("goal_2/five/its_" + std::to_string(its), {fingers(5, case_a), its});
    for (int its : {1, 2}) both("goal_3/one/its_" + std::to_string(its), {fingers(1, case_a), its});
    for (int its : {1, 2})
        both("goal_4/five_topologies_2_threads/its_" + std::to_string(its), {five_topologies, its, 2});
    for (int threads : {1, 2})
        for (int its : {1, 2})
            both("goal_5/256_threads_" + std::to_string(threads) + "/its_" + std::to_string(its),
                 {fingers(256, case_a), its, threads});
    for (int its : {1, 2}) both("goal_6/case_b/its_" + std::to_string(its), {fingers(1, case_b), its});
    for (int elements : {350, 1000, 2000, 4000, 8000, 20000}) {
        both("size/" + std::to_string(elements) + "/its_2", {fingers(1, elements), 2});
        if (elements >= case_b)  // their matrices are factored by both
            both("size/" + std::to_string(elements) + "/its_2/two_threads", {fingers(1, elements), 2, 2});
    }
    return true;
}();

}  // namespace
}  // namespace palpate
