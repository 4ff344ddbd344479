#pragma once
// One evaluation of the incremental potential of a chunk at its current positions: energy, gradient,
// positive definite Newton matrix, contact forces, and how far multipliers are from their fixed point.

#include <algorithm>

#include "engine/bodies/pose_spring.h"
#include "engine/skin/chunks/samples.h"
#include "engine/skin/factor/block_cholesky.h"
#include "engine/skin/solve/bone_stiffness.h"
#include "engine/skin/solve/sample_contact.h"
#include "engine/skin/tissue/linear_tissue.h"

namespace palpate {

namespace detail {

/// Inertia of the nodes: |x - x^|^2 m / 2 dt^2.
template <Want want, class R>
inline void add_inertia(SkinChunk<ScalarOf<R>>& c, ScalarOf<R> inverse_dt2, Evaluation<R>& out) {
    constexpr int W = lane_width<R>;
    const SkinTopology& t = *c.topology;
    for (int i = 0; i < t.node_count; ++i) {
        const R w = R(inverse_dt2) * load<R>(&c.rest.mass[i * W]);
        const Vec3<R> d =
            load_vec3<R>(&c.state.position[3 * i * W]) - load_vec3<R>(&c.scratch.inertia_target[3 * i * W]);
        out.energy += R(ScalarOf<R>(0.5)) * w * dot(d, d);
        add_vec3<R>(&c.scratch.gradient[3 * i * W], w * d);
        if constexpr (want == Want::forces_and_matrix)
            add_block<R>(c.scratch.blocks.data(), t.diagonal_block[i], w * Mat3<R>::identity());
    }
}

/// The bone's springs to its targets.
template <Want want, class R>
inline void add_bone_springs(SkinChunk<ScalarOf<R>>& c, Evaluation<R>& out) {
    constexpr int W = lane_width<R>;
    const SkinTopology& t = *c.topology;
    const Pose<R> bone = load_pose<R>(c.state.bone.data());
    Vec3<R> force{R(0), R(0), R(0)}, torque{R(0), R(0), R(0)};
    R linear(0), angular(0);
    for (int s = 0; s < bone_spring_count; ++s) {
        const ScalarOf<R>* p = &c.scratch.bone_springs[9 * s * W];
        PoseSpring<R> spring{load<R>(p), load<R>(p + W), load_pose<R>(p + 2 * W)};
        if (s == 0) {
            spring.reach = load<R>(&c.scratch.coupling_reach[0]);
            spring.half_turn = load<R>(&c.scratch.coupling_reach[W]);
        }
        const PoseTerms<R> terms = pose_spring(spring, bone);
        out.energy += terms.energy;
        force += terms.force;
        torque += terms.torque;
        linear += terms.linear_curvature;
        angular += terms.angular_curvature;
        if (s == 0) out.coupling_force = norm(terms.force);
    }
    add_vec3<R>(&c.scratch.gradient[3 * t.bone_position * W], force);
    add_vec3<R>(&c.scratch.gradient[3 * t.bone_rotation * W], torque);
    if constexpr (want == Want::forces_and_matrix) {
        add_block<R>(c.scratch.blocks.data(), t.diagonal_block[t.bone_position], linear * Mat3<R>::identity());
        add_block<R>(c.scratch.blocks.data(), t.diagonal_block[t.bone_rotation], angular * Mat3<R>::identity());
    }
}

/// Carries the gradient of the bone nodes over to the bone: dx_a = dp + omega x arm_a. Returns the curvature that
/// the turning of the arms adds along omega.
template <class R>
inline Mat3<R> carry_forces_to_bone(SkinChunk<ScalarOf<R>>& c) {
    constexpr int W = lane_width<R>;
    const SkinTopology& t = *c.topology;
    const Vec3<R> origin = load_vec3<R>(c.state.bone.data());
    Vec3<R> force{R(0), R(0), R(0)}, torque{R(0), R(0), R(0)};
    Mat3<R> turning = Mat3<R>::zero();
    for (int node : t.bone_nodes) {
        const Vec3<R> arm = load_vec3<R>(&c.state.position[3 * node * W]) - origin;
        const Vec3<R> g = load_vec3<R>(&c.scratch.gradient[3 * node * W]);
        force += g;
        torque += torque_of(arm, g);
        turning = turning + turning_curvature(arm, g);
    }
    add_vec3<R>(&c.scratch.gradient[3 * t.bone_position * W], force);
    add_vec3<R>(&c.scratch.gradient[3 * t.bone_rotation * W], torque);
    return turning;
}

/// Contact of one sample with one slot's objects. What is `settled` apart, or less, is not pending.
template <Want want, class R>
inline void add_contact(SkinChunk<ScalarOf<R>>& c, const Slot<R>& there, std::size_t s, const SampleContact<R>& contact,
                        const R& settled, Evaluation<R>& out) {
    constexpr int W = lane_width<R>;
    const SkinTopology& t = *c.topology;
    const std::size_t i = std::size_t(there.index) * t.sample_count() + s;
    const ContactTerms<R>& terms = contact.terms;
    MaskOf<R> near = R(1) < R(0);
    if (!contact.idle) {
        const R change = terms.normal_force - contact.state.normal_multiplier;
        out.energy += terms.energy;
        out.contact_force += terms.normal_force;
        near = absolute(contact.surface.distance) <= settled;
        out.pending += select(near, R(0), change * change);
        const R depth =
            there.any_soft ? select(there.soft, R(0), -contact.surface.distance) : -contact.surface.distance;
        out.penetration = maximum(depth, out.penetration);
        add_at_sample<R>(t, c.scratch.gradient.data(), s, terms.gradient);
        if constexpr (want == Want::forces_and_matrix)
            add_sample_block<R>(t, c.scratch.blocks.data(), s, terms.curvature);
    }
    if (there.any_body) {
        store_vec3<R>(&c.exchange.slot_gradient[3 * i * W], there.of_bodies(terms.gradient));
        store_mat3<R>(&c.exchange.slot_curvature[9 * i * W], there.of_bodies(terms.curvature));
    }
    if (!there.all_body && !contact.idle) {
        add_vec3<R>(&c.scratch.sample_gradient[3 * s * W], there.of_others(terms.gradient));
        if constexpr (want != Want::forces)
            add_block<R>(c.scratch.sample_curvature.data(), int(s), there.of_others(terms.curvature));
    }
    store<R>(&c.scratch.normal_candidate[i * W], terms.normal_force);
    if (!there.rubs) return;
    const Vec3<R> dt = terms.tangential - contact.state.tangential_multiplier;
    const R dr = there.friction * terms.normal_force - contact.state.friction_radius;
    const R walks = settled * load<R>(&c.rest.contact_penalty[s * W]), slip = dot(dt, dt);
    out.pending += select(near & (slip <= walks * walks), R(0), slip) + select(near, R(0), dr * dr);
    store_vec3<R>(&c.scratch.tangential_candidate[3 * i * W], transposed_times(there.rotation, terms.tangential));
    // The gradient of a smoothed mesh is not quite of length one; the tangent plane needs it to be.
    const R length = maximum(norm(contact.local_normal), R(ScalarOf<R>(1e-6)));
    store_vec3<R>(&c.scratch.contact_normal[3 * i * W], (R(1) / length) * contact.local_normal);
}

/// Contact of every sample with every slot's objects.
template <Want want, class R>
inline void add_contacts(SkinChunk<ScalarOf<R>>& c, const R& exactness, Evaluation<R>& out) {
    using T = ScalarOf<R>;
    const R settled(T(c.edge_round > 0 ? fitted::settled_gap : -1));
    std::fill(c.scratch.sample_gradient.begin(), c.scratch.sample_gradient.end(), T(0));
    if constexpr (want != Want::forces)
        std::fill(c.scratch.sample_curvature.begin(), c.scratch.sample_curvature.end(), T(0));
    constexpr int together = samples_together<R>;
    Vec3<R> x[together];
    SampleSurface<R> at[together];
    for (int slot = 0; slot < c.contacts.used; ++slot) {
        const Slot<R> there = read_slot<R>(c, slot);
        for (std::size_t first = 0, count = samples_in_use<R>(c); first < count; first += together) {
            const int n = int(std::min<std::size_t>(together, count - first));
            for (int k = 0; k < n; ++k)
                x[k] = at_sample<R>(*c.topology, c.state.position.data(), first + std::size_t(k));
            find_sample_surfaces(c, there, first, n, x, at);
            for (int k = 0; k < n; ++k) {
                const std::size_t s = first + std::size_t(k);
                add_contact<want>(c, there, s, sample_contact(c, there, s, at[k], exactness), settled, out);
            }
        }
    }
}

/// Zeros in the blocks that something is added to (others are never anything else); all columns of the factor are then
/// out of date.
template <class R>
inline void clear_matrix(SkinChunk<ScalarOf<R>>& c) {
    constexpr std::size_t W9 = 9 * lane_width<R>;
    const BlockPattern& pattern = c.topology->pattern;
    auto* blocks = c.scratch.blocks.data();
    for (int b = 0; b < pattern.block_count; ++b)
        if (pattern.in_matrix(b)) store_mat3<R>(blocks + std::size_t(b) * W9, Mat3<R>::zero());
    std::fill(blocks + std::size_t(pattern.block_count) * W9, blocks + c.scratch.blocks.size(), ScalarOf<R>(0));
    std::fill(c.scratch.changed_columns.begin(), c.scratch.changed_columns.end(), 1);
}

/// How far the limits' forces on the free nodes, and on the bone as a whole, are from their fixed point.
template <class R>
inline void add_pending_of_limits(SkinChunk<ScalarOf<R>>& c, Evaluation<R>& out) {
    constexpr int W3 = 3 * lane_width<R>;
    const SkinTopology& t = *c.topology;
    Vec3<R> bone{R(0), R(0), R(0)};
    for (int i : t.bone_nodes) bone += load_vec3<R>(&c.scratch.pending[i * W3]);
    out.pending += dot(bone, bone);
    for (std::size_t u = 0; u + 2 < t.unknowns.size(); ++u) {
        const Vec3<R> f = load_vec3<R>(&c.scratch.pending[t.unknowns[u] * W3]);
        out.pending += dot(f, f);
    }
}

}  // namespace detail

/// The Newton matrix is positive definite for exactness 0; for 1 it is exact, and may be indefinite.
template <class R, detail::Want want = detail::Want::forces_and_matrix>
inline Evaluation<R> evaluate(SkinChunk<ScalarOf<R>>& c, const SolverSettings& settings, const R& exactness) {
    using T = ScalarOf<R>;
    constexpr int W = lane_width<R>;
    constexpr bool with_matrix = want == detail::Want::forces_and_matrix;
    std::fill(c.scratch.gradient.begin(), c.scratch.gradient.end(), T(0));
    if (c.limits.met) std::fill(c.scratch.pending.begin(), c.scratch.pending.end(), T(0));
    c.limits.met = false;
    if (with_matrix) detail::clear_matrix<R>(c);
    Evaluation<R> out;
    out.extent = load<R>(c.rest.extent.data());
    constexpr auto of_tissue = with_matrix ? want : detail::Want::forces;
    detail::add_tissue<of_tissue>(c, exactness, out);
    if (settings.inertia) detail::add_inertia<of_tissue>(c, T(1 / (settings.dt * settings.dt)), out);
    detail::add_bone_springs<of_tissue>(c, out);
    detail::add_contacts<want>(c, exactness, out);
    const Mat3<R> turning = detail::carry_forces_to_bone<R>(c);
    if (with_matrix) {
        detail::carry_stiffness_to_bone<R>(c);
        detail::add_block<R>(c.scratch.blocks.data(), c.topology->diagonal_block[c.topology->bone_rotation],
                             exactness * turning);
    }
    for (int i : c.topology->unknowns) {
        const Vec3<R> g = load_vec3<R>(&c.scratch.gradient[3 * i * W]);
        R squared = dot(g, g);
        // A torque counts as the force at the finger's extent: in newton metres it would hardly count at all.
        if (i == c.topology->bone_rotation) squared = squared / (out.extent * out.extent);
        out.residual += squared;
    }
    if (c.limits.met) detail::add_pending_of_limits(c, out);
    return out;
}

}  // namespace palpate
