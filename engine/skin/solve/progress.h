#pragma once
// What an iteration does next: of one lane, or of an island of lanes and bodies (R = double). All rules of the
// iteration stand here: chunks that are near no body (solve_lanes.h) and islands (solve_bodies.cpp) share them.
//
// The potential is an augmented Lagrangian (Hestenes 1969, Powell 1969; Rockafellar 1973 for inequalities; for contact
// and friction Alart and Curnier 1991, Simo and Laursen 1992): multipliers are updated where the minimisation in
// positions has come near enough to its end, as in Nocedal and Wright, Numerical Optimization, framework 17.3.

#include <algorithm>
#include <cmath>
#include <limits>

#include "engine/skin/chunks/chunk.h"
#include "engine/skin/solve/fitted.h"
#include "engine/skin/solve/lane_progress.h"

namespace palpate::detail {

/// How many iterations there may be.
template <class R>
inline R iterations_allowed(const SolverSettings& s, const LaneProgress<R>& p) {
    return minimum(R(ScalarOf<R>(s.newton_iterations)) + p.further - p.held_back, p.budget) + p.extra;
}

/// All but the first are held back where the settings say so: while forces are balanced enough. (Not of what touches a
/// body, or a soft object: what is left unbalanced shakes it.) `stiffness`: of the tissue [N/m].
template <class R>
inline void hold_back(const SolverSettings& s, const R& stiffness, LaneProgress<R>& p) {
    using T = ScalarOf<R>;
    p.spares = R(s.unbalanced_share > 0 ? T(1) : T(0));
    p.held_back = p.spares * R(T(s.newton_iterations - 1));
    const R least = minimum(R(T(fitted::least_balanced_force)), R(T(fitted::least_balanced_depth)) * stiffness);
    p.least_force = R(T(std::min(1.0, fitted::balanced_within / s.dt))) * least;
}

/// How little of its residual [squared] an iteration by a kept matrix may leave, not to be slow: where iterations are
/// spared, another one like it may still do.
template <class R>
inline R slow_share(const SolverSettings& s, const LaneProgress<R>& p) {
    using T = ScalarOf<R>;
    constexpr double all = fitted::slow_share * fitted::slow_share,
                     spared = fitted::spared_slow_share * fitted::spared_slow_share;
    const MaskOf<R> more = (p.spares > R(0)) & (p.iterations < R(T(s.newton_iterations)));
    return select(more, R(T(spared)), R(T(all)));
}

/// An iteration that led hardly nearer is not counted; the one in its place waits for being asked for, too.
template <class R>
inline void take_back(LaneProgress<R>& p, MaskOf<R> lanes) {
    p.extra += select(lanes, R(1), R(0));
    p.held_back = select(lanes, maximum(p.held_back, p.spares), p.held_back);
}

/// What tolerances are relative to [N].
template <class R>
inline R force_scale(const Evaluation<R>& e) {
    return maximum(maximum(e.contact_force, e.coupling_force), e.force_floor);
}

/// Balanced so well that what is held back stays so: to a share of the force, or of so little that an imbalance which
/// the next step finds is not felt.
template <class R>
inline MaskOf<R> is_balanced_enough(const Evaluation<R>& e, const SolverSettings& s, const LaneProgress<R>& p) {
    const R allowed = R(ScalarOf<R>(s.unbalanced_share)) * maximum(force_scale(e), p.least_force);
    return (p.held_back > R(0)) & (e.residual <= allowed * allowed);
}

/// The deadline is near: no more iterations than there have been, but one for each finger, and one after an update of
/// multipliers, which without a step after it would count the same violation twice. What is far from balance is
/// solved on all the same, as ever: late is better than thrown.
template <class R>
inline void cut_budget(LaneProgress<R>& p) {
    const MaskOf<R> updated = (p.updates > R(0)) & (p.slope >= R(0));
    p.budget = maximum(R(1), p.iterations + select(updated, R(1), R(0)) - p.extra);
}

template <class R>
inline LaneDecision<R> decide(const Evaluation<R>& e, const R& rounding, const SolverSettings& s, LaneProgress<R>& p) {
    using T = ScalarOf<R>;
    const MaskOf<R> sound = finite(e.energy) & finite(e.residual) & finite(e.pending);
    p.failed = p.failed | (p.active & !sound & (p.iterations <= R(0)));
    p.active = p.active & !p.failed;

    // Energies are known no better than positions are: to the rounding of the finger's extent times the forces on it.
    const R slack = R(T(fitted::energy_roundings) * e.epsilon) * absolute(e.energy) +
                    R(T(fitted::extent_roundings) * e.epsilon) * e.extent * (e.contact_force + e.coupling_force) +
                    e.rounding;
    const MaskOf<R> decreased =
        sound & (e.energy <= p.base_energy + R(T(fitted::sufficient_decrease)) * p.alpha * p.slope + slack);
    // At the rounding of energies, the residual tells whether a step leads on.
    const MaskOf<R> smallest = sound & (p.alpha <= R(T(fitted::smallest_step)));
    const MaskOf<R> taken = decreased | (smallest & ((e.residual <= p.base_residual) | (p.alpha <= R(0))));
    LaneDecision<R> d;
    d.retry = p.active & !taken;
    d.undo = d.retry & smallest;
    p.failed = p.failed | (d.retry & (p.alpha < R(T(fitted::hopeless_step))));
    p.active = p.active & !p.failed;
    d.retry = d.retry & p.active;
    d.undo = d.undo & p.active;

    const R scale = force_scale(e);
    const R tolerance = maximum(minimum(R(T(s.tolerance)) * scale, e.residual_cap), rounding);
    // Forces that are off by the residual allowed leave as much pending.
    const R pending_tolerance = maximum(R(T(s.multiplier_tolerance)) * scale, tolerance);
    const R residual = square_root(e.residual), pending = square_root(e.pending);
    const R gate =
        select(pending > pending_tolerance, maximum(R(T(s.multiplier_gate)) * pending, tolerance), tolerance);
    const MaskOf<R> ready = p.active & !d.retry & (residual <= gate);
    const MaskOf<R> satisfied = (pending <= pending_tolerance) & (e.violation <= R(T(s.limit_tolerance))) &
                                (e.penetration <= R(T(s.contact_tolerance)));
    p.converged = p.converged | (ready & satisfied);
    const MaskOf<R> out_of_budget = p.iterations >= iterations_allowed(s, p);
    // Without a step after it, an update would count the same violation twice: the end of the step updates, too. Nor
    // does one follow another where forces are not balanced: what is pending would be added again and again, each time
    // to a stiffer penalty, and what is small beside it grow with it.
    const MaskOf<R> unbalanced_update = (p.updates > R(0)) & (p.slope >= R(0)) & (residual > tolerance);
    d.update = ready & !satisfied & !out_of_budget & (p.iterations > R(0)) & !unbalanced_update &
               (p.updates < R(T(fitted::updates_per_iteration * s.newton_iterations)));
    const MaskOf<R> first = p.iterations <= R(0);
    // A step that was taken back with all the damping that there is would be taken back again, and again.
    const MaskOf<R> stuck =
        (p.alpha <= R(0)) & (p.slope < R(0)) & (p.exactness <= R(0)) & (p.damping >= R(T(fitted::largest_damping)));
    d.newton = p.active & !d.retry & !out_of_budget & !stuck & ((!ready) | ((first | unbalanced_update) & !satisfied));
    // Where an iteration has thrown what touched off each other, forces are held against what holds the bone.
    const MaskOf<R> touches = e.contact_force > e.force_floor;
    const MaskOf<R> rough = residual > R(T(fitted::spike_share)) * select(touches, e.contact_force, scale);
    const MaskOf<R> holds_body = e.residual_cap < R(std::numeric_limits<T>::max());
    const MaskOf<R> shaky = holds_body & (e.limited > R(0)) &
                            ((residual > R(T(fitted::steady_share)) * e.contact_force) |
                             (pending > R(T(fitted::steady_pending_share)) * e.contact_force));
    const MaskOf<R> unbalanced =
        (p.held_back > R(0)) & (p.budget >= R(T(s.newton_iterations))) & !is_balanced_enough(e, s, p);
    // What goes on evaluates again, with a matrix.
    const MaskOf<R> goes_on =
        p.active & !d.retry & out_of_budget & !stuck &
        (unbalanced | (rough & (p.extra < R(T(fitted::most_extra_iterations)))) |
         (shaky & (p.budget >= R(T(s.newton_iterations))) & (p.extra < R(T(s.steadying_iterations)))));
    p.held_back -= select(goes_on & unbalanced, R(1), R(0));
    p.extra += select(goes_on & !unbalanced, select(rough, R(T(fitted::extra_iterations)), R(1)), R(0));
    p.active = d.retry | d.update | d.newton | goes_on;
    return d;
}

/// Halves the steps of the lanes that retry. Where even the smallest half leads uphill, a penalty has woken on the way
/// that the matrix does not know, and grows as a parabola: its lowest point is tried, so that the next matrix knows it.
/// Where that is no way down either, the step is taken back: what follows is then damped as much as can be.
template <class R>
inline void shorten_steps(LaneProgress<R>& p, const LaneDecision<R>& d, const Evaluation<R>& e) {
    using T = ScalarOf<R>;
    const R rise = e.energy - p.base_energy - p.alpha * p.slope;
    const R lowest = R(T(-0.5)) * p.slope * p.alpha * p.alpha / rise;
    const MaskOf<R> parabola = d.undo & (p.alpha >= R(T(fitted::smallest_step))) & (rise > R(0)) &
                               (lowest > R(T(2 * fitted::hopeless_step))) & (lowest < p.alpha);
    const MaskOf<R> undo = d.undo & !parabola;
    p.alpha = select(d.retry, select(undo, R(0), select(parabola, lowest, R(T(0.5)) * p.alpha)), p.alpha);
    p.backtracks += select(d.retry, R(1), R(0));
    p.uphill += select(undo, R(1), R(0));
}

/// Lanes whose potential is another one from here on: there is nothing to compare energies with.
template <class R>
inline void forget_energy(LaneProgress<R>& p, MaskOf<R> lanes) {
    p.base_energy = select(lanes, R(std::numeric_limits<ScalarOf<R>>::max()), p.base_energy);
}

/// After a multiplier update.
template <class R>
inline void count_update(LaneProgress<R>& p, MaskOf<R> lanes) {
    p.updates += select(lanes, R(1), R(0));
    forget_energy(p, lanes);
    p.alpha = select(lanes, R(1), p.alpha);
    p.slope = select(lanes, R(0), p.slope);
}

/// Levenberg-Marquardt: a step that the line search had to shorten promised more than the potential held,
/// mostly because elements turned too far for their linearised stretches, or because contacts and limits
/// changed. The next one is damped by about the tissue's own stiffness, and less and less where steps fit.
template <class R>
inline void adapt_damping(LaneProgress<R>& p, MaskOf<R> lanes) {
    using T = ScalarOf<R>;
    const MaskOf<R> stepped = lanes & (p.slope < R(0));
    const R more = minimum(maximum(R(T(fitted::more_damping)) * p.damping, R(1)), R(T(fitted::largest_damping)));
    const R less = R(T(fitted::less_damping)) * p.damping;
    p.damping = select(stepped, select(p.alpha < R(T(fitted::full_step)), more, less), p.damping);
}

/// Less exact curvature where the matrix was indefinite, more where it was not.
template <class R>
inline void adapt_exactness(LaneProgress<R>& p, MaskOf<R> indefinite, MaskOf<R> definite) {
    using T = ScalarOf<R>;
    const R less = select(p.exactness > R(T(fitted::hardly_exact)), R(T(fitted::less_exact)) * p.exactness, R(0));
    const R more = minimum(R(1), select(p.exactness > R(0), R(T(fitted::more_exact)) * p.exactness, R(1)));
    p.exactness = select(indefinite, less,
                         select(definite & (p.iterations + R(1) >= R(T(fitted::exact_after))), more, p.exactness));
    p.exactness = select((indefinite | definite) & (p.iterations > R(T(fitted::exact_until))), R(0), p.exactness);
}

/// What becomes of a direction.
template <class R>
struct DirectionVerdict {
    MaskOf<R> step;     ///< the lanes move along it
    MaskOf<R> unbound;  ///< linear tissue made the matrix indefinite: it is left
};

/// An indefinite matrix gives no direction: the lane stays, and evaluates again with less exact curvature, or without
/// linear tissue where that is what `linear` lanes have. Lanes that step begin a line search from here.
template <class R>
inline DirectionVerdict<R> judge_direction(LaneProgress<R>& p, MaskOf<R> newton, MaskOf<R> linear, const R& bad_pivots,
                                           const R& slope, const Evaluation<R>& e) {
    const MaskOf<R> bad = bad_pivots > R(0);
    const MaskOf<R> unbound = newton & linear & (bad | (slope > R(0)));
    const MaskOf<R> unusable = unbound | (newton & (p.exactness > R(0)) & (bad | (slope >= R(0))));
    forget_energy(p, unusable);
    p.slope = select(unusable, R(0), p.slope);
    p.iterations += select(unusable & !unbound, R(1), R(0));
    adapt_exactness(p, unusable, newton & !unusable);
    const MaskOf<R> step = newton & !unusable;
    p.slope = select(step, slope, p.slope);
    p.alpha = select(step, R(1), p.alpha);
    p.base_energy = select(step, e.energy, p.base_energy);
    p.base_residual = select(step, e.residual, p.base_residual);
    p.iterations += select(step, R(1), R(0));
    return {step, unbound};
}

/// What is reported of a lane that was solved, by code of lanes R.
template <class R>
inline SkinStatus status_of(const Evaluation<double>& e, const LaneProgress<double>& p, const SolverSettings& settings,
                            bool reset) {
    SkinStatus s;
    s.newton_iterations = int(p.iterations);
    s.multiplier_updates = int(p.updates);
    s.backtracks = int(p.backtracks);
    s.uphill_steps = int(p.uphill);
    s.extra_iterations = int(p.extra);
    s.converged = p.converged;
    s.cut_short = p.budget < settings.newton_iterations && !p.converged;
    s.reset = reset;
    if (reset) return s;
    s.residual_N = std::sqrt(e.residual);
    s.limit_violation = e.violation;
    s.penetration_m = e.penetration;
    s.contact_force_N = e.contact_force;
    s.limited_elements = int(e.limited);
    return s;
}

}  // namespace palpate::detail
