#pragma once
// Where an iteration stands: what was evaluated, how far each lane is, what was decided. The rules that lead from one
// to the next are progress.h's: a change of rules compiles what iterates anew, not all that knows a world.

#include <limits>

#include "engine/math/lanes.h"

namespace palpate {

template <class R>
struct Evaluation {
    R energy{0};          ///< [J]
    R residual{0};        ///< squared norm of the gradient [N^2]
    R pending{0};         ///< squared norm of the change of nodal forces that a multiplier update would bring
                          ///< [N^2]; stresses in equilibrium with themselves do not count
    R violation{0};       ///< worst relative excess over a strain limit
    R penetration{0};     ///< worst [m]
    R contact_force{0};   ///< sum of normal forces [N]
    R coupling_force{0};  ///< norm of the coupling's force [N]
    R limited{0};         ///< elements with an active limit
    R limits_met{0};      ///< sum of these limits' numbers: another one where others act
    R margin = std::numeric_limits<ScalarOf<R>>::max();  ///< least distance of a principal stretch from a limit
    ScalarOf<R> epsilon = std::numeric_limits<ScalarOf<R>>::epsilon();  ///< of the precision it was computed in
    R extent{ScalarOf<R>(0.03)};                                        ///< of the finger [m]
    R force_floor{ScalarOf<R>(0.01)};                          ///< tolerances are relative to no less than this [N]
    R residual_cap = std::numeric_limits<ScalarOf<R>>::max();  ///< the residual may not be more than this [N]
    R rounding{0};                                             ///< of the energy, beyond what extent and forces say [J]
};

namespace detail {

/// Where each lane stands in its iteration.
template <class R>
struct LaneProgress {
    MaskOf<R> active;                            ///< not finished
    MaskOf<R> converged, failed;                 ///< how it finished
    R base_energy, base_residual, slope, alpha;  ///< of the running line search; the residual squared
    R exactness;                                 ///< share of exact curvature in the next Newton matrix
    R last_excess, last_depth;  ///< of limits, of contacts: violation over tolerance at the last multiplier update
    R damping;                  ///< added to the diagonal of the next Newton matrix, in units of the tissue's stiffness
    R iterations{0}, updates{0}, backtracks{0};
    R budget = std::numeric_limits<ScalarOf<R>>::max();  ///< of iterations, once the deadline has cut it
    R further{0};                                        ///< iterations in place of following contacts
    R spares{0};                                         ///< one where balance has to ask for iterations
    R held_back{0};                                      ///< of those, the ones that it does not ask for yet
    R least_force{0};                                    ///< what balance is a share of is no less [N]
    R extra{0};                                          ///< iterations granted beyond the budget
    R uphill{0};                                         ///< steps that were taken back: no halving led to less energy
};

template <class R>
inline LaneProgress<R> begin_progress(MaskOf<R> active) {
    constexpr auto most = std::numeric_limits<ScalarOf<R>>::max();
    LaneProgress<R> p;
    p.active = active;
    p.converged = p.failed = mask_from_bits<R>(0);
    p.exactness = p.slope = p.alpha = p.damping = R(0);
    p.base_energy = p.base_residual = p.last_excess = p.last_depth = R(most);
    return p;
}

/// What the lanes do next; each active lane does exactly one of the three.
template <class R>
struct LaneDecision {
    MaskOf<R> retry, update, newton;
    MaskOf<R> undo;  ///< of those that retry: back to where the step began, for a direction of another length
};

}  // namespace detail

}  // namespace palpate
