#pragma once
// NLopt's SLSQP over the configurations of a device (Perez et al. 2017, Eqs. 1 and 2), guarded against its known
// failures: it may return points that are infeasible or not finite, or never stop on them, so the best feasible one
// is kept here.

#include "devices/matching/descent.h"

namespace palpate {

struct SlsqpProblem {
    const DeviceModel* model = nullptr;
    const NearSamples* samples = nullptr;  ///< of the matching objective; null: the distance to `previous`, scaled
    const MatchingSettings* settings = nullptr;
    Coordinates previous;     ///< warm start, or the configuration to project
    bool constrained = true;  ///< inside the joint limits
};

/// Minimises from `start`. The search runs in coordinates in which the
/// Gauss-Newton Hessian at the start is the identity, for that is what SLSQP assumes of it.
Descent minimise(const SlsqpProblem& problem, const Coordinates& start);

}  // namespace palpate
