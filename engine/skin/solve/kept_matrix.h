#pragma once
// The Newton matrix, kept from step to step. Tissue that has moved little has nearly the stiffness that it had: it is
// assembled anew in every `stiffness_steps`-th step, and in between only what contact adds to it follows, so that of
// the factor no more than the columns of changed contacts and of what they are eliminated into are made anew. Forces
// are always those of the tissue as it is: a kept matrix makes no error, but an iteration that comes nearer to the
// solution by less (the chord method; Kelley 1995, Iterative Methods for Linear and Nonlinear Equations, 5.4).
//
// Whether a lane's matrix is kept follows from the lane and the number of the step alone, so that a finger is the same
// bits alone or beside others.

#include <algorithm>

#include "engine/skin/solve/evaluate.h"
#include "engine/skin/solve/progress.h"

namespace palpate::detail {

/// Bits of the lanes that have a matrix to keep.
template <class R>
inline unsigned lanes_with_matrix(const SkinChunk<ScalarOf<R>>& c) {
    return bits_from_mask<R>(load<R>(c.state.matrix_kept.data()) > R(0));
}

/// The lanes' matrix is not to be kept, for so many steps (SkinState::matrix_kept).
template <class R>
inline void forget_matrix(SkinChunk<ScalarOf<R>>& c, MaskOf<R> lanes, int steps = 0) {
    auto* p = c.state.matrix_kept.data();
    const R old = load<R>(p);
    store<R>(p, select(lanes, minimum(old, R(ScalarOf<R>(-steps))), old));
}

/// Adds a stiffness at a node of the bone to the blocks of the bone (carry_stiffness_to_bone).
template <class R>
inline void add_sample_block_of_bone(SkinChunk<ScalarOf<R>>& c, std::size_t s, const Mat3<R>& K) {
    constexpr int W3 = 3 * lane_width<R>;
    const SkinTopology& t = *c.topology;
    const Vec3<R> arm =
        load_vec3<R>(&c.state.position[std::size_t(t.samples[s] * W3)]) - load_vec3<R>(c.state.bone.data());
    const Mat3<R> turned = cross_columns(arm, K);
    auto* blocks = c.scratch.blocks.data();
    add_block<R>(blocks, t.diagonal_block[std::size_t(t.bone_position)], K);
    add_block<R>(blocks, t.bone_cross_block, turned);
    add_block<R>(blocks, t.diagonal_block[std::size_t(t.bone_rotation)],
                 transpose(cross_columns(arm, transpose(turned))));
    for (int unknown : {t.bone_position, t.bone_rotation})
        c.scratch.changed_columns[std::size_t(t.elimination[std::size_t(unknown)])] = 1;
}

/// Lanes in which `now` differs from `held` by more than a share of that.
template <class R>
inline MaskOf<R> differs_by_share(const Mat3<R>& now, const Mat3<R>& held, const R& share) {
    R largest(0), largest_change(0);
    for (int i = 0; i < 9; ++i) {
        const R h = held.m[i / 3][i % 3];
        largest = maximum(absolute(h), largest);
        largest_change = maximum(absolute(now.m[i / 3][i % 3] - h), largest_change);
    }
    return !(largest_change <= share * largest);
}

/// What has changed by more than that; else what was held.
template <class R>
inline Mat3<R> changed_curvature(const Mat3<R>& now, const Mat3<R>& held, const R& share) {
    return select(differs_by_share(now, held, share), now, held);
}

/// Lets the matrix have a sample's curvature as it is, in the masked lanes in which it differs from what the matrix
/// has by more than a share of that.
template <class R>
inline void put_in_matrix(SkinChunk<ScalarOf<R>>& c, std::size_t s, const Mat3<R>& curvature, MaskOf<R> lanes,
                          const R& share) {
    auto* held = &c.scratch.contact_in_matrix[9 * s * lane_width<R>];
    const Mat3<R> old = load_mat3<R>(held);
    const MaskOf<R> differs = lanes & differs_by_share(curvature, old, share);
    if (!any(differs)) return;
    const Mat3<R> change = select(differs, curvature - old, Mat3<R>::zero());
    store_mat3<R>(held, select(differs, curvature, old));
    if (!is_free_sample(*c.topology, s)) return add_sample_block_of_bone<R>(c, s, change);
    add_sample_block<R>(*c.topology, c.scratch.blocks.data(), s, change);
    mark_sample_columns<R>(*c.topology, s, c.scratch.changed_columns);
}

/// Lanes at their limits whose budget is too small for a kept matrix.
template <class R>
inline unsigned lanes_short_at_limits(const SkinChunk<ScalarOf<R>>& c, const SolverSettings& settings) {
    unsigned lanes = 0;
    if (settings.newton_iterations >= fitted::kept_iterations) return lanes;
    for (int l = 0; l < lane_width<R>; ++l)
        if (c.status[std::size_t(l)].limited_elements > 0) lanes |= 1u << l;
    return lanes;
}

/// How much of a contact's curvature may differ in the matrix of each lane: nothing where it is never kept.
template <class R>
inline R contact_share_of(const SkinChunk<ScalarOf<R>>& c, const SolverSettings& settings) {
    if (!c.keeps_matrix) return R(0);
    return select(mask_from_bits<R>(lanes_short_at_limits<R>(c, settings)), R(0),
                  R(ScalarOf<R>(fitted::kept_contact_share)));
}

/// Calls visit(values) for the curvatures that bodies have at a sample in the last evaluation, one for each slot of
/// any.
template <class T, class Visit>
inline void for_each_body_curvature(SkinChunk<T>& c, std::size_t s, Visit visit) {
    const std::size_t W = std::size_t(c.width);
    for (int slot = 0; slot < c.contacts.used; ++slot)
        if (c.contacts.slot[std::size_t(slot)].body_lanes != 0)
            visit(&c.exchange.slot_curvature[9 * (std::size_t(slot) * c.topology->sample_count() + s) * W]);
}

/// Curvature of all contacts of a sample at the last evaluation.
template <class R>
inline Mat3<R> contact_curvature(SkinChunk<ScalarOf<R>>& c, std::size_t s) {
    constexpr int W = lane_width<R>;
    if (c.scratch.sample_curvature.empty()) return Mat3<R>::zero();  // no object has come near yet
    Mat3<R> sum = load_mat3<R>(&c.scratch.sample_curvature[9 * s * W]);
    if (!c.has_bodies || s >= samples_in_use<R>(c)) return sum;
    for_each_body_curvature(c, s, [&](const auto* values) { sum = sum + load_mat3<R>(values); });
    return sum;
}

/// Lanes in which no more than one object has a curvature at a sample.
template <class R>
inline MaskOf<R> lanes_with_one_curvature(SkinChunk<ScalarOf<R>>& c, std::size_t s) {
    const R none(0), one(1);
    auto count = [&](const auto* values) {
        const Mat3<R> K = load_mat3<R>(values);
        return select(K[0][0] + K[1][1] + K[2][2] > none, one, none);
    };
    R objects = count(&c.scratch.sample_curvature[9 * s * lane_width<R>]);
    for_each_body_curvature(c, s, [&](const auto* values) { objects += count(values); });
    return objects <= one;
}

/// Where the matrix has kept another curvature of a sample than the last evaluation found, it is the one by which
/// bodies are coupled, too: with one that differs, the condensed matrix need not be definite.
template <class R>
inline void take_curvature_of_matrix(SkinChunk<ScalarOf<R>>& c, std::size_t s, MaskOf<R> lanes) {
    const Mat3<R> held = load_mat3<R>(&c.scratch.contact_in_matrix[9 * s * lane_width<R>]);
    const R none(0);
    auto take = [&](auto* values) {
        const Mat3<R> K = load_mat3<R>(values);
        store_mat3<R>(values, select(lanes & (K[0][0] + K[1][1] + K[2][2] > none), held, K));
    };
    take(&c.scratch.sample_curvature[9 * s * lane_width<R>]);
    for_each_body_curvature(c, s, take);
}

/// Lets kept matrices have contacts as they are, but where those differ by less than a share.
template <class R>
inline void follow_in_matrix(SkinChunk<ScalarOf<R>>& c, MaskOf<R> kept, const R& share) {
    const bool coupled = c.has_bodies && !c.scratch.sample_curvature.empty();
    for (std::size_t s = 0; 9 * s * lane_width<R> < c.scratch.contact_in_matrix.size(); ++s) {
        const Mat3<R> now = contact_curvature<R>(c, s);
        if (!coupled || s >= samples_in_use<R>(c)) {
            put_in_matrix<R>(c, s, now, kept, share);
            continue;
        }
        const MaskOf<R> one = lanes_with_one_curvature<R>(c, s);
        put_in_matrix<R>(c, s, now, kept, select(one, share, R(0)));
        take_curvature_of_matrix<R>(c, s, kept & one);
    }
}

/// After an evaluation with a matrix: notes what contact has added to it in the masked lanes, and whether it may be
/// kept.
template <class R>
inline void note_matrix(SkinChunk<ScalarOf<R>>& c, const Evaluation<R>& e, MaskOf<R> lanes, MaskOf<R> keepable) {
    constexpr int W = lane_width<R>;
    for (std::size_t s = 0; 9 * s * W < c.scratch.contact_in_matrix.size(); ++s) {
        auto* held = &c.scratch.contact_in_matrix[9 * s * W];
        store_mat3<R>(held, select(lanes, contact_curvature<R>(c, s), load_mat3<R>(held)));
    }
    if (!c.keeps_matrix) return;
    auto* kept = c.state.matrix_kept.data();
    const R old = load<R>(kept),
            now = select(keepable & (old >= R(0)) & !mask_from_bits<R>(c.soft_lanes), R(1), minimum(old, R(0)));
    store<R>(kept, select(lanes, now, old));
    store<R>(c.state.matrix_limits.data(), select(lanes, e.limits_met, load<R>(c.state.matrix_limits.data())));
}

/// Of the lanes that keep their matrix, those in which other limits act than it knows: tissue at its limits is in
/// motion.
template <class R>
inline unsigned take_other_limits(SkinChunk<ScalarOf<R>>& c, const Evaluation<R>& e, unsigned kept) {
    const R known = load<R>(c.state.matrix_limits.data());
    const unsigned other = bits_from_mask<R>((e.limits_met < known) | (e.limits_met > known)) & kept;
    if (other != 0) {
        const MaskOf<R> lanes = mask_from_bits<R>(other);
        forget_matrix<R>(c, lanes, fitted::unkept_steps);
        auto* wait = c.state.matrix_wait.data();
        const R old = load<R>(wait);
        store<R>(wait, select(lanes, maximum(old, R(fitted::unkept_steps)), old));
    }
    return other;
}

/// Takes a matrix that was assembled in the factor's memory in the masked lanes; the others keep theirs.
template <class R>
inline void take_assembled(SkinChunk<ScalarOf<R>>& c, unsigned lanes) {
    constexpr std::size_t W9 = 9 * std::size_t(lane_width<R>);
    const MaskOf<R> mask = mask_from_bits<R>(lanes);
    const BlockPattern& pattern = c.topology->pattern;
    for (int b = 0; b < pattern.block_count; ++b) {
        if (!pattern.in_matrix(b)) continue;
        const auto* assembled = &c.scratch.factor[std::size_t(b) * W9];
        auto* held = &c.scratch.blocks[std::size_t(b) * W9];
        for (std::size_t i = 0; i < W9; i += std::size_t(lane_width<R>))
            store<R>(held + i, select(mask, load<R>(assembled + i), load<R>(held + i)));
    }
}

/// What an evaluation does with the matrices of a chunk.
template <class R>
struct MatrixRequest {
    MaskOf<R> lanes;     ///< that need one; that of the others stays as it is
    MaskOf<R> renew;     ///< of these, those that are not to keep it
    MaskOf<R> keepable;  ///< those whose new one may be kept
    R share;             ///< by which contacts of a kept one may be off
};

/// Evaluation for a linear solve.
template <class R>
inline Evaluation<R> evaluate_keeping(SkinChunk<ScalarOf<R>>& c, const SolverSettings& settings, const R& exactness,
                                      const MatrixRequest<R>& request) {
    const unsigned wanted = bits_from_mask<R>(request.lanes) & active_lanes(c), others = active_lanes(c) & ~wanted;
    unsigned kept = c.keeps_matrix ? lanes_with_matrix<R>(c) & wanted & ~bits_from_mask<R>(request.renew) : 0;
    Evaluation<R> e;
    bool assembled = false;
    if (kept == wanted) {
        e = evaluate<R, Want::forces_and_contacts>(c, settings, exactness);
        kept &= ~take_other_limits<R>(c, e, kept);
    }
    if (kept != wanted) {
        const bool some_stay = c.keeps_matrix && (kept | others) != 0;
        if (some_stay) std::swap(c.scratch.blocks, c.scratch.factor);  // what follows makes the factor anew
        e = evaluate<R>(c, settings, exactness);
        kept &= ~take_other_limits<R>(c, e, kept);
        if (some_stay) {
            std::swap(c.scratch.blocks, c.scratch.factor);
            take_assembled<R>(c, ~(kept | others));
        }
        assembled = true;
    }
    if (assembled) note_matrix<R>(c, e, mask_from_bits<R>(wanted & ~kept), request.keepable);
    if (kept == 0) return e;
    const MaskOf<R> keeping = mask_from_bits<R>(kept);
    auto* state = c.state.matrix_kept.data();
    store<R>(state, select(keeping, R(2), load<R>(state)));
    follow_in_matrix<R>(c, keeping, request.share);
    return e;
}

/// Lanes that a kept matrix has led on, and hardly nearer to the solution: too much changes for it. The iteration is
/// not counted. (What is balanced well enough is near.)
template <class R>
inline MaskOf<R> slow_lanes(SkinChunk<ScalarOf<R>>& c, const Evaluation<R>& e, const SolverSettings& settings,
                            LaneProgress<R>& p) {
    if (!c.keeps_matrix) return mask_from_bits<R>(0);
    const MaskOf<R> led = p.active & (p.iterations > R(0)) & (load<R>(c.state.matrix_kept.data()) > R(1));
    const MaskOf<R> slow =
        led & (e.residual > slow_share(settings, p) * p.base_residual) & !is_balanced_enough(e, settings, p);
    take_back(p, slow);
    auto* wait = c.state.matrix_wait.data();
    store<R>(wait, select(led & !slow, R(1), load<R>(wait)));
    return slow;
}

/// These have matrices of their own for some steps, the more of them the more often that was so.
template <class R>
inline void wait_with_matrix(SkinChunk<ScalarOf<R>>& c, MaskOf<R> lanes) {
    auto *kept = c.state.matrix_kept.data(), *wait = c.state.matrix_wait.data();
    const R old = load<R>(kept), last = load<R>(wait), steps = maximum(last, R(fitted::unkept_steps));
    store<R>(kept, select(lanes, minimum(old, -steps), old));
    store<R>(wait, select(lanes, minimum(R(2) * steps, R(fitted::longest_wait)), last));
}

}  // namespace palpate::detail
