#pragma once
// Tissue whose elasticity is linear about where it was in an earlier step: its gradient and its Hessian are those of
// that place, turned with the bone, so that no element is decomposed but those near a strain limit. What that leaves
// out grows with the square of the change of the deformation gradients since then.

#include "engine/skin/tissue/membranes.h"
#include "engine/skin/tissue/patch_limits.h"
#include "engine/skin/tissue/patches.h"

namespace palpate::detail {

/// Rotation of the bone since the place of linearisation.
template <class R>
inline Mat3<R> turn_since(const SkinChunk<ScalarOf<R>>& c, const Mat3<R>& rotation) {
    return times_transposed(rotation, load_mat3<R>(c.linear.frame.data()));
}

/// Keeps gradient and Hessian of the tissue, which the evaluation has just made, for the lanes that are due.
template <class R>
inline void linearise_tissue(SkinChunk<ScalarOf<R>>& c, const Pose<R>& bone, const Evaluation<R>& e) {
    using T = ScalarOf<R>;
    constexpr int W = lane_width<R>;
    LinearTissue<T>& l = c.linear;
    const MaskOf<R> due = mask_from_bits<R>(l.due_lanes);
    auto keep = [&](T* to, const R& value) { store<R>(to, select(due, value, load<R>(to))); };
    const Mat3<R> rotation = rotation_matrix(bone.rotation);
    for (int i = 0; i < 9; ++i) keep(&l.frame[std::size_t(i * W)], rotation.m[i / 3][i % 3]);
    for (std::size_t i = 0; i < l.arm.size(); i += 3 * W)
        for (int d = 0; d < 3; ++d) {
            const std::size_t k = i + std::size_t(d * W);
            keep(&l.arm[k], load<R>(&c.state.position[k]) - bone.position[d]);
            keep(&l.force[k], load<R>(&c.scratch.gradient[k]));
        }
    for (std::size_t p = 0; p < l.pairs.size(); ++p)
        for (std::size_t i = 0; i < 9; ++i)
            keep(&l.blocks[(9 * p + i) * W], load<R>(&c.scratch.blocks[(9 * std::size_t(l.pairs[p].block) + i) * W]));
    keep(l.energy.data(), e.energy);
    const R reach = maximum(R(T(fitted::reach_share)) * e.margin, R(0));
    keep(l.reach.data(), reach);
    l.fresh_lanes = l.due_lanes;
    l.kept_lanes |= l.due_lanes;
    l.due_lanes = 0;
}

/// How far nodes are from the place of linearisation, and what being linear costs there: lanes that it would cost more
/// than they are allowed, or that could meet a strain limit, go on with tissue as it is.
template <class R>
inline void follow_linear_tissue(SkinChunk<ScalarOf<R>>& c, const Pose<R>& bone) {
    using T = ScalarOf<R>;
    constexpr int W = lane_width<R>, W3 = 3 * W;
    const SkinTopology& t = *c.topology;
    LinearTissue<T>& l = c.linear;
    const Mat3<R> turn = turn_since(c, rotation_matrix(bone.rotation));
    for (std::size_t u = 0; u + 2 < t.unknowns.size(); ++u) {
        const int i = t.unknowns[u] * W3;
        store_vec3<R>(&l.moved[i], transposed_times(turn, load_vec3<R>(&c.state.position[i]) - bone.position) -
                                       load_vec3<R>(&l.arm[i]));
    }
    R error(0), largest(0);
    for (std::size_t e = 0; e < t.elements.size(); ++e) {
        Vec3<R> moved[4], g[3];
        for (int a = 0; a < 4; ++a) moved[a] = load_vec3<R>(&l.moved[std::size_t(t.elements[e][a] * W3)]);
        for (int a = 0; a < 3; ++a) g[a] = load_vec3<R>(&c.rest.shape_gradients[(9 * e + 3 * a) * W]);
        const Mat3<R> change = deformation_gradient(moved, g);
        R squared(0);
        for (int i = 0; i < 9; ++i) squared += change.m[i / 3][i % 3] * change.m[i / 3][i % 3];
        error += load<R>(&l.weight[e * W]) * squared;
        if (l.watched.empty()) continue;
        // A patch that is not watched changes by no more than the most of its elements, watched ones included.
        const MaskOf<R> counts = !(load<R>(&l.watched[e * W]) > R(0));
        largest = maximum(!t.limit_patches.empty() ? squared : select(counts, squared, R(0)), largest);
    }
    store<R>(l.error.data(), error);
    const R reach = load<R>(l.reach.data());
    const unsigned within = bits_from_mask<R>((error <= load<R>(l.bound.data())) & (largest <= reach * reach));
    l.left_lanes = c.linear_lanes & ~within;
    leave_linear_tissue(c, l.left_lanes);
}

/// Energy, gradient and, where wanted, Hessian of linear tissue, into the linear lanes of the evaluation; `alone` where
/// no other lane is solved.
template <bool with_matrix, class R>
inline void set_linear_tissue(SkinChunk<ScalarOf<R>>& c, const Pose<R>& bone, bool alone, Evaluation<R>& out) {
    using T = ScalarOf<R>;
    constexpr int W = lane_width<R>, W3 = 3 * W;
    LinearTissue<T>& l = c.linear;
    const MaskOf<R> linear = mask_from_bits<R>(alone ? ~0u : c.linear_lanes);
    const Mat3<R> turn = turn_since(c, rotation_matrix(bone.rotation));
    l.moved_force = l.force;
    for (std::size_t p = 0; p < l.pairs.size(); ++p) {
        const auto [block, a, b] = l.pairs[p];
        const Mat3<R> K = load_mat3<R>(&l.blocks[9 * p * W]);
        auto add = [&](int node, const Vec3<R>& f) {
            T* to = &l.moved_force[std::size_t(node * W3)];
            store_vec3<R>(to, load_vec3<R>(to) + f);
        };
        add(a, K * load_vec3<R>(&l.moved[std::size_t(b * W3)]));
        if (a != b) add(b, transposed_times(K, load_vec3<R>(&l.moved[std::size_t(a * W3)])));
        if constexpr (with_matrix) {
            const Mat3<R> turned = times_transposed(turn * K, turn);
            T* to = &c.scratch.blocks[9 * std::size_t(block) * W];
            if (alone)
                store_mat3<R>(to, turned);
            else
                for (int i = 0; i < 9; ++i)
                    store<R>(to + i * W, select(linear, turned.m[i / 3][i % 3], load<R>(to + i * W)));
        }
    }
    R energy = load<R>(l.energy.data());
    for (std::size_t i = 0; i < l.force.size(); i += W3) {
        const Vec3<R> force = load_vec3<R>(&l.moved_force[i]);
        energy += R(T(0.5)) * dot(load_vec3<R>(&l.moved[i]), load_vec3<R>(&l.force[i]) + force);
        T* to = &c.scratch.gradient[i];
        store_vec3<R>(to, select(linear, turn * force, load_vec3<R>(to)));
    }
    out.energy = select(linear, energy, out.energy);
    out.violation = select(linear, R(0), out.violation);
    out.limited = select(linear, R(0), out.limited);
}

/// Strain limits of the elements and patches near one, in the masked lanes.
template <Want want, class R>
inline void add_watched_limits(SkinChunk<ScalarOf<R>>& c, MaskOf<R> lanes, const R& exactness, Evaluation<R>& out) {
    constexpr int W = lane_width<R>;
    const std::size_t elements = c.topology->elements.size();
    for (std::size_t e = 0; e < elements; ++e) {
        const MaskOf<R> watched = lanes & (load<R>(&c.linear.watched[e * W]) > R(0));
        if (!any(watched)) continue;
        const Mat3<R> F = element_deformation<R>(c, e);
        Vec3<R> g[3];
        for (int a = 0; a < 3; ++a) g[a] = load_vec3<R>(&c.rest.shape_gradients[(9 * e + 3 * a) * W]);
        add_strain_limit<want>(c, e, F, signed_svd(F), g, load<R>(&c.rest.volume[e * W]), exactness, watched, out);
    }
    for (std::size_t e = elements; e < c.topology->limit_count(); ++e) {
        const MaskOf<R> watched = lanes & (load<R>(&c.linear.watched[e * W]) > R(0));
        if (!any(watched)) continue;
        const Mat3<R> F = patch_deformation<R>(c, e - elements);
        add_patch_limit<want>(c, e - elements, F, signed_svd(F), exactness, watched, out);
    }
}

/// All elements as they are, one by one or in patches, with their membranes.
template <Want want, class R>
inline void add_all_elements(SkinChunk<ScalarOf<R>>& c, const ElementRequest<R>& request, Evaluation<R>& out) {
    if (c.material != Material::corotational) {
        add_elements<want>(c, request, out);
    } else {
        if (c.topology->patches.empty())
            add_corotational_elements<want>(c, request, out);
        else
            add_patches<want>(c, request, out);
        if (c.has_limits) {
            note_patch_limits<R>(c, request.watches);
            add_noted_limits<want>(c, request, out);
        }
    }
    if (c.has_membranes) add_membranes<want>(c, request.exactness, out);
}

/// Tissue of all lanes, of each as it is to be in this step.
template <Want want, class R>
inline void add_tissue(SkinChunk<ScalarOf<R>>& c, const R& exactness, Evaluation<R>& out) {
    constexpr bool with_matrix = want == Want::forces_and_matrix;
    const MaskOf<R> all = R(0) <= R(0);
    if (c.linear.pairs.empty()) {
        add_all_elements<want>(c, ElementRequest<R>{all, exactness, exactness}, out);
        c.limits.candidates_clear |= !c.limits.met;
        return;
    }
    const Pose<R> bone = load_pose<R>(c.state.bone.data());
    c.linear.fresh_lanes = c.linear.left_lanes = 0;
    if (c.linear_lanes != 0) follow_linear_tissue<R>(c, bone);
    const unsigned due = c.linear.due_lanes, apart = due | c.linear_lanes;
    if ((active_lanes(c) & ~c.linear_lanes) != 0 || apart == 0) {
        // An exact Hessian is what forces are linear in; limits are left out of it.
        const MaskOf<R> linearised = mask_from_bits<R>(due);
        add_all_elements<want>(c,
                               ElementRequest<R>{mask_from_bits<R>(~apart), select(linearised, R(1), exactness),
                                                 exactness, linearised, due != 0},
                               out);
        if (with_matrix && due != 0) linearise_tissue(c, bone, out);
    }
    if (c.linear_lanes != 0) set_linear_tissue<with_matrix>(c, bone, (active_lanes(c) & ~c.linear_lanes) == 0, out);
    if (apart != 0 && c.has_limits) add_watched_limits<want>(c, mask_from_bits<R>(apart), exactness, out);
    if (c.linear_lanes == 0) c.limits.candidates_clear |= !c.limits.met;
}

}  // namespace palpate::detail
