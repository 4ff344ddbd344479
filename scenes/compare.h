#pragma once
// The paper's error analysis: what would the pad feel on the device, against what it should feel.

#include "scenes/simulation.h"

namespace palpate {

/// The pad of one finger, fixed at the nail, pressed by a thimble's platform.
struct PadOnPlatform {
    World world;
    EntityId finger;
};
PadOnPlatform make_pad_on_platform(const FingerSpec& finger, const DeviceModel& model);

/// Puts the platform to configuration w, solves for static equilibrium and returns the force on each
/// pad sample, finger frame [N]. `converged` says whether the solve met its tolerances.
std::vector<Vec3<double>> resimulate(PadOnPlatform& pad, const DeviceModel& model, const Coordinates& w,
                                     oneapi::tbb::task_arena& arena, bool& converged);

/// One rendering step of one finger.
struct ComparedStep {
    double time = 0, roll_deg = 0;
    double virtual_force_N = 0;       ///< sum of |F_i| of the virtual contact
    std::array<double, 3> error_N{};  ///< sum of |F_i - Fbar_i| per method, in MatchingMethod's order
    std::array<MatchingResult, 3> result;
    std::array<bool, 3> converged{};
};

/// Runs the scene; at each rendering step of each thimble solves all three methods and re-simulates.
std::vector<std::vector<ComparedStep>> compare(Simulation& simulation, const std::atomic<bool>& stop,
                                               const std::function<void(double)>& progress);

}  // namespace palpate
