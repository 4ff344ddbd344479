#pragma once
// The implicit step of a chunk that is near no body: its lanes iterate (newton.h), each at its own pace.

#include "engine/skin/solve/follow_limits.h"
#include "engine/skin/solve/skin_step.h"

namespace palpate {

namespace detail {

/// A chunk's lanes as newton.h iterates them.
template <class R>
struct LaneSolve {
    using T = ScalarOf<R>;

    SkinChunk<T>& c;
    const SolverSettings& settings;
    MaskOf<R> solved = mask_from_bits<R>(active_lanes(c));
    LaneProgress<R> p = begin_progress<R>(solved);
    R share = contact_share_of<R>(c, settings);
    MaskOf<R> at_limits = mask_from_bits<R>(lanes_short_at_limits<R>(c, settings));
    Evaluation<R> e{};
    LaneDecision<R> d{};
    MaskOf<R> slow{};
    MatrixRequest<R> matrix{};
    R slope{0}, bad_pivots{0};

    bool goes_on() const { return any(p.active); }
    bool updates() const { return any(d.update); }
    bool steps() const { return any(d.newton); }
    bool moves() const { return any(d.newton | d.retry); }
    void cut_budgets() { cut_budget(p); }

    void evaluate() {
        const MaskOf<R> may_step = p.active & (p.iterations < iterations_allowed(settings, p));
        const MaskOf<R> keepable = (p.exactness <= R(0)) & (p.damping <= R(0));
        const MaskOf<R> enough = p.iterations >= R(T(fitted::kept_iterations));
        const MaskOf<R> renew = (!keepable) | enough | at_limits;
        matrix = {may_step, renew, keepable, share};
        e = any(may_step) ? evaluate_keeping<R>(c, settings, p.exactness, matrix)
                          : palpate::evaluate<R, Want::forces>(c, settings, p.exactness);
        if (c.linear.left_lanes != 0) forget_energy(p, mask_from_bits<R>(c.linear.left_lanes));
    }

    void decide() {
        slow = slow_lanes(c, e, settings, p);
        d = detail::decide(e, rounding_force(c, e), settings, p);
        if (any(slow)) wait_with_matrix<R>(c, slow & !p.converged);
        if (any(d.retry)) shorten_steps(p, d, e);
    }

    void renew_slow_matrices() {
        matrix.lanes = slow & d.newton;
        if (any(matrix.lanes)) e = evaluate_keeping<R>(c, settings, p.exactness, matrix);
    }

    void update_multipliers() {
        stiffen_slow_lanes(c, settings, e, d.update, p.last_excess, p.last_depth);
        detail::update_multipliers<R>(c, d.update);
        count_update(p, d.update);
    }

    void find_directions() {
        adapt_damping(p, d.newton);
        damp<R>(c, d.newton, p.damping);
        if (c.keeps_matrix) forget_matrix<R>(c, d.newton & (p.damping > R(0)));
        slope = newton_direction<R>(c, d.newton, bad_pivots);
        follow_contacts_of_lanes<R>(c, settings, d.newton & (p.exactness <= R(0)), p.exactness, e.residual, slope,
                                    bad_pivots);
        // Where steps have fitted, there was nothing in their way.
        slope = follow_limits<R>(c, d.newton & (p.damping > R(0)), slope);
    }

    void judge_directions() {
        const MaskOf<R> linear = mask_from_bits<R>(c.linear_lanes | c.linear.fresh_lanes);
        const auto verdict = judge_direction(p, d.newton, linear, bad_pivots, slope, e);
        if (any(verdict.unbound)) leave_linear_tissue(c, bits_from_mask<R>(verdict.unbound));
        d.newton = verdict.step;
        keep_base<R>(c, d.newton);
    }

    void move() { move_from_base<R>(c, d.newton | d.retry, p.alpha); }
};

}  // namespace detail

/// Advances a chunk by one step. Reads bone springs and contact slots; writes state and status.
/// No allocation. The result of a lane does not depend on what the other lanes hold.
template <class R>
void solve_chunk(SkinChunk<ScalarOf<R>>& c, const SolverSettings& settings) {
    detail::begin_step<R>(c, settings);
    detail::LaneSolve<R> solve{c, settings};
    detail::hold_back<R>(settings, load<R>(c.rest.tissue_stiffness.data()), solve.p);
    detail::keep_base<R>(c, solve.solved);
    detail::iterate(solve, c.cut);
    const unsigned reset = detail::end_iteration<R>(c, solve.e, solve.solved, solve.p.failed, solve.p.converged);
    if (reset != 0) detail::forget_matrix<R>(c, mask_from_bits<R>(reset));
    detail::record_status(c, settings, solve.e, solve.p, reset);
    detail::end_step<R>(c, settings);
}

}  // namespace palpate
