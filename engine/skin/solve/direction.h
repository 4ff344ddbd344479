#pragma once
// The direction of a Newton step: the linear solve, and contacts followed along it.

#include <algorithm>

#include "engine/skin/factor/supernode_threads.h"
#include "engine/skin/solve/kept_matrix.h"
#include "engine/skin/solve/newton.h"

namespace palpate {

namespace detail {

/// Factors the Newton matrix, of its columns those that have changed since it was last factored. Returns per lane the
/// number of pivots that had to be replaced in these.
template <class R>
inline R factor_matrix(SkinChunk<ScalarOf<R>>& c) {
    const SkinTopology& t = *c.topology;
    auto& changed = c.scratch.changed_columns;
    mark_ancestors(t.pattern, changed.data());
    R bad_pivots;
    if constexpr (lane_width<R> == 1)
        bad_pivots = c.threads
                         ? factor_supernodes_together<R>(t.supernodes, t.pattern, c.scratch.blocks.data(),
                                                         c.scratch.panels.data(), c.scratch.panel_work.data(),
                                                         changed.data(), c.scratch.factored, *c.threads)
                         : factor_supernodes<R>(t.supernodes, t.pattern, c.scratch.blocks.data(),
                                                c.scratch.panels.data(), c.scratch.panel_work.data(), changed.data());
    else
        bad_pivots = factor_blocks<R>(t.pattern, c.scratch.blocks.data(), c.scratch.factor.data(), changed.data());
    std::fill(changed.begin(), changed.end(), 0);
    return bad_pivots;
}

/// Adds what has changed of a sample's curvature to the Newton matrix; the sample must be free.
template <class R>
inline void change_sample_block(SkinChunk<ScalarOf<R>>& c, std::size_t s, const Mat3<R>& change) {
    MaskOf<R> none = R(0) <= R(0);
    for (int i = 0; i < 9; ++i) none = none & (absolute(change.m[i / 3][i % 3]) <= R(0));  // not a number is a change
    if (all(none)) return;
    add_block<R>(c.scratch.contact_in_matrix.data(), int(s), change);
    add_sample_block<R>(*c.topology, c.scratch.blocks.data(), s, change);
    mark_sample_columns<R>(*c.topology, s, c.scratch.changed_columns);
}

/// Solves L y = b, with the factor L, for the right-hand side in scratch.permuted, in place.
template <class R>
inline void solve_forward(SkinChunk<ScalarOf<R>>& c) {
    const SkinTopology& t = *c.topology;
    if constexpr (lane_width<R> == 1)
        solve_supernodes_forward<R>(t.supernodes, c.scratch.panels.data(), c.scratch.permuted.data(),
                                    c.scratch.panel_work.data());
    else
        solve_blocks_forward<R>(t.pattern, c.scratch.factor.data(), c.scratch.permuted.data());
}
/// Solves L^T y = b.
template <class R>
inline void solve_backward(SkinChunk<ScalarOf<R>>& c) {
    const SkinTopology& t = *c.topology;
    if constexpr (lane_width<R> == 1)
        solve_supernodes_backward<R>(t.supernodes, c.scratch.panels.data(), c.scratch.permuted.data(),
                                     c.scratch.panel_work.data());
    else
        solve_blocks_backward<R>(t.pattern, c.scratch.factor.data(), c.scratch.permuted.data());
}
/// Both: L L^T y = b.
template <class R>
inline void solve_matrix(SkinChunk<ScalarOf<R>>& c) {
    solve_forward<R>(c);
    solve_backward<R>(c);
}

/// Slope g . d of the masked lanes' direction.
template <class R>
inline R slope_of(const SkinChunk<ScalarOf<R>>& c) {
    constexpr int W3 = 3 * lane_width<R>;
    R slope(0);
    for (int i : c.topology->unknowns)
        slope += dot(load_vec3<R>(&c.scratch.direction[i * W3]), load_vec3<R>(&c.scratch.gradient[i * W3]));
    return slope;
}

/// Newton direction -H^-1 g of the masked lanes, and its slope.
template <class R>
inline R newton_direction(SkinChunk<ScalarOf<R>>& c, MaskOf<R> lanes, R& bad_pivots) {
    constexpr int W3 = 3 * lane_width<R>;
    const SkinTopology& t = *c.topology;
    bad_pivots = factor_matrix<R>(c);
    for (int i : t.unknowns)
        store_vec3<R>(&c.scratch.permuted[t.elimination[i] * W3], -load_vec3<R>(&c.scratch.gradient[i * W3]));
    solve_matrix<R>(c);
    for (int i : t.unknowns) {
        auto* p = &c.scratch.direction[i * W3];
        store_vec3<R>(p, select(lanes, load_vec3<R>(&c.scratch.permuted[t.elimination[i] * W3]), load_vec3<R>(p)));
    }
    return slope_of<R>(c);
}

/// What all contacts of a sample do.
template <class R>
struct SampleForce {
    Vec3<R> gradient{R(0), R(0), R(0)};
    Mat3<R> curvature = Mat3<R>::zero();
    bool idle = true;
};

/// Of `count` samples from `first` on, at the end of the direction.
template <class R>
inline void contacts_along_direction(const SkinChunk<ScalarOf<R>>& c, std::size_t first, int count, const R& exactness,
                                     SampleForce<R>* out) {
    const SkinTopology& t = *c.topology;
    Vec3<R> x[samples_together<R>];
    SampleSurface<R> at[samples_together<R>];
    for (int k = 0; k < count; ++k) {
        const std::size_t s = first + std::size_t(k);
        x[k] = at_sample<R>(t, c.state.position.data(), s) + at_sample<R>(t, c.scratch.direction.data(), s);
    }
    for (int slot = 0; slot < c.contacts.used; ++slot) {
        const Slot<R> there = read_slot<R>(c, slot);
        find_sample_surfaces(c, there, first, count, x, at);
        for (int k = 0; k < count; ++k) {
            const std::size_t s = first + std::size_t(k);
            if (!is_free_sample(t, s)) continue;
            const SampleContact<R> contact = sample_contact(c, there, s, at[k], exactness);
            if (contact.idle) continue;
            out[k].gradient += contact.terms.gradient;
            out[k].curvature = out[k].curvature + contact.terms.curvature;
            out[k].idle = false;
        }
    }
}

/// Whether `count` numbers have nothing but zeros in all lanes; what is not a number is none.
template <class R>
inline bool all_zero(const ScalarOf<R>* p, int count) {
    MaskOf<R> zero = R(0) <= R(0);
    for (int i = 0; i < count; ++i) zero = zero & (absolute(load<R>(p + i * lane_width<R>)) <= R(0));
    return all(zero);
}

/// What contact does at the end of the direction, beyond what its linearisation said: r = c(x + d) - c(x) - C d of
/// every sample on a free node. Takes the new gradient and curvature as the current ones, the change of curvature into
/// the matrix, and leaves r as right-hand side. Returns |r|^2.
template <class R>
inline R contact_residual(SkinChunk<ScalarOf<R>>& c, MaskOf<R> lanes, const R& exactness, const R& share) {
    using T = ScalarOf<R>;
    constexpr int W3 = 3 * lane_width<R>, together = samples_together<R>;
    const SkinTopology& t = *c.topology;
    const Vec3<R> zero{R(0), R(0), R(0)};
    R squared(0);
    for (std::size_t first = 0, count = samples_in_use<R>(c); first < count; first += together) {
        const int n = int(std::min<std::size_t>(together, count - first));
        SampleForce<R> now[together];
        contacts_along_direction(c, first, n, exactness, now);
        for (int k = 0; k < n; ++k) {
            const std::size_t s = first + std::size_t(k);
            if (!is_free_sample(t, s)) continue;
            T* old_gradient = &c.scratch.sample_gradient[s * W3];
            const T* old = &c.scratch.contact_in_matrix[3 * s * W3];
            if (now[k].idle && all_zero<R>(old_gradient, 3) && all_zero<R>(old, 9)) {
                store_vec3<R>(&c.scratch.sample_residual[s * W3], zero);
                continue;
            }
            const Vec3<R> step = at_free_sample<R>(t, c.scratch.permuted.data(), s);
            const Vec3<R> r =
                select(lanes, now[k].gradient - load_vec3<R>(old_gradient) - load_mat3<R>(old) * step, zero);
            squared += dot(r, r);
            put_in_matrix<R>(c, s, now[k].curvature, lanes, share);
            store_vec3<R>(old_gradient, now[k].gradient);
            store_vec3<R>(&c.scratch.sample_residual[s * W3], r);
        }
    }
    return squared;
}

/// Lanes whose contacts are followed along their directions (newton.h).
template <class R>
struct FollowedLanes {
    using T = ScalarOf<R>;
    static constexpr int W = lane_width<R>, W3 = 3 * W;

    SkinChunk<T>& c;
    const SolverSettings& settings;
    MaskOf<R> lanes;
    const R &exactness, &residual;
    R& slope;
    R& bad_pivots;  ///< where contacts open, a matrix with exact or linear tissue may be indefinite
    R first_slope = slope;

    /// Ends following where contact did little beyond its linearisation.
    void find_contact_residuals() {
        const R left = contact_residual<R>(c, lanes, exactness, contact_share_of<R>(c, settings));
        lanes = lanes & (left > R(T(settings.contact_share * settings.contact_share)) * residual);
    }
    bool follow() const { return any(lanes); }
    void add_to_directions() {
        const SkinTopology& t = *c.topology;
        bad_pivots += select(lanes, factor_matrix<R>(c), R(0));
        std::fill(c.scratch.permuted.begin(), c.scratch.permuted.end(), T(0));
        for (std::size_t s = 0; s < samples_in_use<R>(c); ++s)
            if (is_free_sample(t, s))
                add_at_free_sample<R>(t, c.scratch.permuted.data(), s,
                                      -load_vec3<R>(&c.scratch.sample_residual[s * W3]));
        solve_matrix<R>(c);
        for (int i : t.unknowns) {
            T *step = &c.scratch.permuted[t.elimination[i] * W3], *direction = &c.scratch.direction[i * W3];
            const Vec3<R> masked = select(lanes, load_vec3<R>(step), Vec3<R>{R(0), R(0), R(0)});
            store_vec3<R>(step, masked);
            store_vec3<R>(direction, load_vec3<R>(direction) + masked);
        }
    }
    void keep_better() {
        slope = slope_of<R>(c);
        const MaskOf<R> worse = slope >= R(0);
        if (!any(worse)) return;
        for (std::size_t i = 0; i < c.scratch.direction.size(); i += W)
            store<R>(&c.scratch.direction[i],
                     select(worse, load<R>(&c.scratch.first_direction[i]), load<R>(&c.scratch.direction[i])));
        slope = select(worse, first_slope, slope);
    }
};

/// Follows the contacts of lanes whose direction leads downhill.
template <class R>
inline void follow_contacts_of_lanes(SkinChunk<ScalarOf<R>>& c, const SolverSettings& settings, MaskOf<R> lanes,
                                     const R& exactness, const R& residual, R& slope, R& bad_pivots) {
    if (settings.contact_iterations <= 0 || c.contacts.used == 0) return;
    c.scratch.first_direction = c.scratch.direction;
    lanes = lanes & (slope < R(0));
    FollowedLanes<R> followed{c, settings, lanes, exactness, residual, slope, bad_pivots};
    follow_contacts(followed, settings.contact_iterations);
}

}  // namespace detail

}  // namespace palpate
