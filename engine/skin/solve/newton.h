#pragma once
// Newton on the augmented Lagrangian, and contacts followed along its directions: the one text of both. What iterates
// is either the lanes of a chunk that is near no body, each at its own pace (solve_lanes.h), or islands of lanes,
// bodies and soft objects (bodies/solve_bodies.cpp); what each of them does next is decided by progress.h.

#include "engine/skin/chunks/step_cut.h"

namespace palpate::detail {

/// Iterates until everything in `solve` has converged, failed, or used its iterations.
template <class Solve>
inline void iterate(Solve& solve, StepCut& cut) {
    for (int pass = 0;; ++pass) {
        if (cut.is_late(pass) && cut.at == pass) solve.cut_budgets();
        solve.evaluate();  // with a matrix where a step may follow
        solve.decide();    // halves steps that led nowhere
        if (!solve.goes_on()) return;
        solve.renew_slow_matrices();
        if (solve.updates()) solve.update_multipliers();
        if (solve.steps()) {
            solve.find_directions();
            solve.judge_directions();
        }
        if (solve.moves()) solve.move();
    }
}

/// Improves directions where contacts open, close, stick or slide along them, by at most so many further linear solves:
/// Newton on the same linearised tissue with contact as it is. That costs no element, and of a factorisation what
/// follows of the contacts that change. A direction that leads uphill so is given up for the one it began with.
template <class Directions>
inline void follow_contacts(Directions& directions, int most_solves) {
    for (int k = 0; k < most_solves; ++k) {
        directions.find_contact_residuals();
        if (!directions.follow()) break;
        directions.add_to_directions();
    }
    directions.keep_better();
}

}  // namespace palpate::detail
