#pragma once
// A scene being run: world, device loops, recorded series.

#include <atomic>
#include <functional>
#include <memory>

#include "engine/step.h"
#include "scenes/recording/series.h"
#include "scenes/scene.h"

namespace palpate {

struct Simulation {
    Scene scene;
    World world;
    std::unique_ptr<oneapi::tbb::task_arena> arena;
    std::vector<EntityId> fingers;                    ///< in the scene's order
    std::vector<std::unique_ptr<ThimbleLoop>> loops;  ///< per thimble
    std::vector<Series> finger_series;                ///< one row per step
    std::vector<std::int64_t> finger_resets;          ///< per finger: times it diverged and was reset
    Series step_series;                               ///< wall time per system, one row per step
};

/// Threads: 0 = as many as the machine has.
Simulation make_simulation(Scene scene, int threads);

/// One step: trackers and scripts in, world stepped, device loops ticked, one row recorded.
void advance(Simulation& simulation);

/// Runs to the scene's end or until `stop`; calls progress(share done) now and then.
void run(Simulation& simulation, const std::atomic<bool>& stop, const std::function<void(double)>& progress);

}  // namespace palpate
