#pragma once
// A run seen step by step: what laws of a single run it breaks, and what is left of it for laws that compare runs.

#include "scenes/recording/run_file.h"
#include "scenes/run/simulation.h"
#include "scenes/studies/random/watched.h"

namespace palpate {

/// Normal force of every finger in every step [step][finger], and whether the step was solved to its tolerance.
struct Trace {
    std::vector<std::vector<double>> force;
    std::vector<std::vector<std::uint64_t>> hashes;
    std::vector<Vec3<double>> bodies;  ///< where they are in the end, in the order of the objects [m]
    bool all_converged = true;
    bool fingers_near = false;  ///< each other, in some step
    bool overlapped = false;    ///< objects had to be taken out of each other
    double iterations = 0;      ///< Newton's, of all fingers: what it has cost
};

/// Runs a scene to its end. `found`: held against the laws of every step; `recorder`: recorded.
Trace watch(Simulation& s, Findings* found, RunWriter* recorder = nullptr);

}  // namespace palpate
