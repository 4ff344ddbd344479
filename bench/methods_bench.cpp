// Which formulation of limits and contact gives the smallest force-field error per microsecond? One finger of about 347
// tetrahedra in double, five tasks, three time steps; errors against a converged solve with the same time step.

#include <benchmark/benchmark.h>

#include <chrono>
#include <cmath>
#include <functional>
#include <map>

#include "bench/field_error.h"
#include "bench/methods/body.h"
#include "engine/build.h"
#include "engine/step.h"
#include "engine/systems.h"
#include "scenes/load/finger_mesh.h"

namespace palpate::methods {
namespace {

const TetMesh& finger() {
    static const TetMesh mesh = [] {
        FingerTemplates templates;
        std::string note;
        FingerMeshRequest request;
        request.shape = finger_shape("index");
        return make_finger_mesh(request, templates, note);
    }();
    return mesh;
}

struct Task {
    std::string name;
    Constraints constraints;
    double duration;
    std::function<Vec3<double>(double)> target;  ///< bone's target, from the touch on [m]
    double max_force = Coupling{}.max_force;
};

double ramp(double t, double from, double to) { return std::clamp((t - from) / (to - from), 0.0, 1.0); }

const std::vector<Task>& tasks() {
    static const std::vector<Task> all{
        {"press",
         {0.7, 1.3, 0},
         0.3,
         [](double t) {
             return Vec3<double>{0, 0, -2.5e-3 * ramp(t, 0, 0.25)};
         }},
        {"tight",
         {0.9, 1.1, 0},
         0.3,
         [](double t) {
             return Vec3<double>{0, 0, -2.5e-3 * ramp(t, 0, 0.25)};
         }},
        {"slide",
         {0.7, 1.3, 0.5},
         0.4,
         [](double t) {
             return Vec3<double>{4e-3 * ramp(t, 0.15, 0.4), 0, -1.5e-3 * ramp(t, 0, 0.15)};
         }},
        {"release",
         {0.7, 1.3, 0},
         0.3,
         [](double t) {
             return Vec3<double>{0, 0, -2.5e-3 * ramp(t, 0, 0.1) + 3e-3 * ramp(t, 0.15, 0.3)};
         }},
        {"1000_N",
         {0.7, 1.3, 0},
         0.3,
         [](double t) {
             return Vec3<double>{0, 0, -0.5 * ramp(t, 0, 0.25)};
         },
         2000},
    };
    return all;
}

SceneSpec scene_of(const Task& task, double dt, bool bare) {
    SceneSpec spec;
    spec.solver.dt = dt;
    spec.solver.newton_iterations = 400;
    FingerSpec f;
    f.name = "finger";
    f.mesh = finger();
    f.has_limits = !bare;
    f.limit_low = task.constraints.low;
    f.limit_high = task.constraints.high;
    f.coupling.max_force = task.max_force;
    spec.fingers.push_back(f);
    if (!bare) spec.objects.push_back({"plane", {}, Pose<double>::identity(), task.constraints.friction});
    return spec;
}

struct Outcome {
    ForceFields forces;
    double us_per_step = 0, violation = 0;
};

/// Worst relative excess over a stretch bound.
double violation_of(const SkinChunk<double>& c, const Constraints& k) {
    double worst = 0;
    for (std::size_t e = 0; e < c.topology->elements.size(); ++e)
        for (int i = 0; i < 3; ++i) {
            const double s = stretched(c, e).svd.sigma[i];
            worst = std::max({worst, (s - k.high) / k.high, (k.low - s) / k.low});
        }
    return worst;
}

/// Runs a task in steps of dt: by the engine with its settings changed by `change`, in `substeps` each; or by `method`.
Outcome run(const Task& task, double dt, int substeps, const std::function<void(SolverSettings&)>& change,
            Method* method) {
    SceneSpec spec = scene_of(task, dt / substeps, method != nullptr);
    if (change) change(spec.solver);
    double lowest = 0;
    for (const Point& p : finger().nodes) lowest = std::min(lowest, p[2]);
    spec.fingers[0].start.position.z = 2e-5 - lowest;
    World world = build_world(spec);
    Threads threads(1);
    Outcome out;
    const int steps = int(std::lround(task.duration / dt));
    double seconds = 0;
    for (int k = 1; k <= steps; ++k) {
        for (int i = 1; i <= substeps; ++i) {
            const double t = dt * (k - 1 + double(i) / substeps);
            const Vec3<double> at = task.target(t);
            world.tracker_poses[0].incoming = {
                {{at.x, at.y, 2e-5 - lowest + at.z}, Quaternion<double>::identity()}, t, true};
            if (method) {
                read_trackers(world.solver.dt, world.tracker_poses, world.pose_filters);
                couple(world.tracker_poses, world.solver, world.skins, world.couplings, world.chunks);
                const auto start = std::chrono::steady_clock::now();
                method->step(world.chunks.doubles[0], world.solver);
                seconds += std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
            } else {
                step(world, threads);
                seconds += world.profile.solve_skin;
            }
        }
        out.forces.push_back(method ? method->force : world.contact_surfaces[0].force);
        out.violation = std::max(out.violation, violation_of(world.chunks.doubles[0], task.constraints));
    }
    out.us_per_step = 1e6 * seconds / steps;
    return out;
}

void compare(benchmark::State& state, const Task& task, double dt, const std::string& method, int iterations) {
    static std::map<std::string, Outcome> references;
    const std::string key = task.name + std::to_string(dt);
    if (!references.count(key)) references[key] = run(task, dt, 1, {}, nullptr);
    auto budget = [](int newton_iterations) {
        return [=](SolverSettings& s) {
            s.newton_iterations = newton_iterations;
            s.tolerance = 1e-4;
            s.multiplier_tolerance = 1e-3;
        };
    };
    Outcome out;
    for (auto _ : state) {
        std::unique_ptr<Method> other;
        if (method == "linearised_dual") other = linearised_dual(task.constraints, iterations, 30);
        if (method == "interior_point") other = interior_point(task.constraints, iterations);
        if (method == "gated_multipliers") out = run(task, dt, 1, budget(iterations), nullptr);
        if (method == "small_steps") out = run(task, dt, iterations, budget(1), nullptr);  // one iteration in each
        if (other) out = run(task, dt, 1, {}, other.get());
        state.SetIterationTime(1e-6 * out.us_per_step);
    }
    const FieldError error = field_error(out.forces, references[key].forces, 1e-3);
    state.counters["field_error_%"] = 100 * error.field;
    state.counters["total_error_%"] = 100 * error.total;
    state.counters["violation_%"] = 100 * out.violation;
}

const bool registered = [] {
    for (const Task& task : tasks())
        for (int dt_ms : {1, 5, 20})
            for (const char* method : {"gated_multipliers", "small_steps", "linearised_dual", "interior_point"})
                for (int iterations : {1, 2, 4, 8})
                    benchmark::RegisterBenchmark(("method/" + task.name + "/" + std::to_string(dt_ms) + "_ms/" +
                                                  method + "/" + std::to_string(iterations))
                                                     .c_str(),
                                                 [&task, dt_ms, method, iterations](benchmark::State& state) {
                                                     compare(state, task, 1e-3 * dt_ms, method, iterations);
                                                 })
                        ->Iterations(1)
                        ->UseManualTime()
                        ->Unit(benchmark::kMicrosecond);
    return true;
}();

}  // namespace
}  // namespace palpate::methods
