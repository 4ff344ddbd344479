#pragma once
// One evaluation of the incremental potential of a chunk at its current positions: energy, gradient,
// positive definite Newton matrix, contact forces, and how far multipliers are from their fixed point.

#include <algorithm>

#include "engine/bodies/pose_spring.h"
#include "engine/contact/contact_terms.h"
#include "engine/skin/block_cholesky.h"
#include "engine/skin/linear.h"
#include "engine/skin/samples.h"

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
        const PoseSpring<R> spring{load<R>(p), load<R>(p + W), load_pose<R>(p + 2 * W)};
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

/// Carries the stiffness of the bone nodes over to the bone.
template <class R>
inline void carry_stiffness_to_bone(SkinChunk<ScalarOf<R>>& c) {
    constexpr int W = lane_width<R>;
    const SkinTopology& t = *c.topology;
    ScalarOf<R>* blocks = c.scratch.blocks.data();
    auto block = [&](int b) { return load_mat3<R>(blocks + static_cast<std::size_t>(b) * 9 * W); };
    const Vec3<R> origin = load_vec3<R>(c.state.bone.data());
    auto arm = [&](int node) { return load_vec3<R>(&c.state.position[3 * node * W]) - origin; };
    for (const auto& edge : t.bone_edges) {
        const Mat3<R> K = block(edge.block);
        add_block<R>(blocks, edge.position, K);
        add_block<R>(blocks, edge.rotation, cross_columns(arm(edge.bone_node), K));
    }
    Mat3<R> pp = Mat3<R>::zero(), rp = Mat3<R>::zero(), rr = Mat3<R>::zero();
    for (const auto& pair : t.bone_pairs) {
        const Mat3<R> K = block(pair.block), turned = cross_columns(arm(pair.a), K);
        const Mat3<R> both = transpose(cross_columns(arm(pair.b), transpose(turned)));
        pp = pp + K;
        rp = rp + turned;
        rr = rr + both;
        if (pair.a == pair.b) continue;
        pp = pp + transpose(K);
        rp = rp + cross_columns(arm(pair.b), transpose(K));
        rr = rr + transpose(both);
    }
    add_block<R>(blocks, t.diagonal_block[t.bone_position], pp);
    add_block<R>(blocks, t.bone_cross_block, rp);
    add_block<R>(blocks, t.diagonal_block[t.bone_rotation], rr);
}

/// Where a slot's object is in this step: at its end, and at its start.
template <class R>
struct SlotFrame {
    Mat3<R> rotation;
    Vec3<R> position;
    const ScalarOf<R>* start;  ///< rotation 3x3 and position; friction alone asks for them
};
template <class R>
inline SlotFrame<R> slot_frame(const SkinChunk<ScalarOf<R>>& c, int slot) {
    constexpr int W = lane_width<R>;
    const ScalarOf<R>* frame = &c.scratch.slot_frame[24 * std::size_t(slot) * W];
    return {load_mat3<R>(frame), load_vec3<R>(frame + 9 * W), frame + 12 * W};
}

/// Coulomb coefficients of the lanes against the object of a slot.
template <class R>
inline R slot_friction(const SkinChunk<ScalarOf<R>>& c, int slot) {
    const ContactSlot& s = c.slots[slot];
    const auto& own = c.rest.object_friction;
    return own.empty() ? R(ScalarOf<R>(s.friction)) : load<R>(&own[std::size_t(s.object) * lane_width<R>]);
}

/// One sample at x against one slot's object. Slip is the way of the sample over the object in this step, measured in
/// the object's frame: where the object turns, friction turns with it, and the potential depends on where the two are
/// relative to each other alone, so that action equals reaction.
template <class R>
struct SampleContact {
    SurfacePoint<R> surface;
    Vec3<R> local_normal;  ///< object's frame
    ContactState<R> state;
    bool friction;
    bool soft;  ///< the object gives way: its force is what its depth makes it, and no multiplier
    bool idle;  ///< touches in no lane, nor did at the last multiplier update: all terms are zero, and left out
    ContactTerms<R> terms;
};
template <class R>
inline SampleContact<R> sample_contact(const SkinChunk<ScalarOf<R>>& c, int slot, const SlotFrame<R>& frame,
                                       std::size_t s, const Vec3<R>& x, const R& exactness) {
    using T = ScalarOf<R>;
    constexpr int W = lane_width<R>;
    const ContactSlot& object = c.slots[slot];
    const std::size_t i = slot * c.topology->sample_count() + s;
    const Vec3<R> zero{R(0), R(0), R(0)};
    SampleContact<R> out;
    const Vec3<R> local = transposed_times(frame.rotation, x - frame.position);
    out.surface = local_surface_point(object.shape, local);
    out.local_normal = out.surface.normal;
    if (s >= c.topology->samples.size() && (c.fine_lanes & c.used_lanes) != c.used_lanes)
        out.surface.distance = select(mask_from_bits<R>(c.fine_lanes), out.surface.distance, R(T(1)));
    out.friction = c.has_friction && object.friction > 0;
    out.state = {load<R>(&c.state.normal_multiplier[i * W]), zero, R(0), zero};
    // Where nodes stick and slide by turns, Newton cycles about the kink between the two if friction is much stiffer
    // than tissue; creep is not a matter of the penalty, its multiplier takes it away.
    const R base = load<R>(&c.rest.contact_penalty[s * W]), scale = load<R>(&c.state.penalty_scale[W]);
    const R k_slip = base * minimum(scale, R(T(16)));
    R k = base * scale;
    out.soft = object.stiffness > 0;
    if (out.soft) {
        out.state.normal_multiplier = R(0);
        k = R(T(object.stiffness)) * load<R>(&c.rest.contact_area[s * W]);
    }
    MaskOf<R> idle = (out.state.normal_multiplier <= R(0)) & (k * out.surface.distance >= R(0));
    Vec3<R> tangential = zero;
    if (out.friction) {
        out.state.friction_radius = load<R>(&c.state.friction_radius[i * W]);
        tangential = load_vec3<R>(&c.state.tangential_multiplier[3 * i * W]);
        idle = idle & (out.state.friction_radius <= R(0)) & (dot(tangential, tangential) <= R(0));
    }
    out.idle = all(idle);
    if (out.idle) {
        out.terms = {R(0), zero, Mat3<R>::zero(), R(0), zero};
        return out;
    }
    out.surface.normal = frame.rotation * out.local_normal;
    Vec3<R> slip = zero;
    if (out.friction) {
        out.state.tangential_multiplier = frame.rotation * tangential;
        out.state.friction_normal = frame.rotation * load_vec3<R>(&c.state.friction_normal[3 * i * W]);
        const Vec3<R> before = at_sample<R>(*c.topology, c.scratch.start_position.data(), s);
        slip = frame.rotation *
               (local - transposed_times(load_mat3<R>(frame.start), before - load_vec3<R>(frame.start + 9 * W)));
    }
    out.terms = contact_terms(out.surface, slip, k, k_slip, out.state, out.friction, exactness);
    if (out.soft) out.state.normal_multiplier = out.terms.normal_force;  // nothing of it is pending
    return out;
}

/// Contact of every sample with every slot's object.
template <Want want, class R>
inline void add_contacts(SkinChunk<ScalarOf<R>>& c, const R& exactness, Evaluation<R>& out) {
    using T = ScalarOf<R>;
    constexpr int W = lane_width<R>;
    const SkinTopology& t = *c.topology;
    std::fill(c.scratch.sample_gradient.begin(), c.scratch.sample_gradient.end(), T(0));
    std::fill(c.scratch.sample_curvature.begin(), c.scratch.sample_curvature.end(), T(0));
    for (const int slot : occupied_slots(c)) {
        const SlotFrame<R> frame = slot_frame<R>(c, slot);
        const R friction = slot_friction<R>(c, slot);
        for (std::size_t s = 0; s < samples_in_use<R>(c); ++s) {
            const std::size_t i = slot * t.sample_count() + s;
            const SampleContact<R> contact =
                sample_contact<R>(c, slot, frame, s, at_sample<R>(t, c.state.position.data(), s), exactness);
            const ContactTerms<R>& terms = contact.terms;
            if (!contact.idle) {
                const R change = terms.normal_force - contact.state.normal_multiplier;
                out.energy += terms.energy;
                out.contact_force += terms.normal_force;
                out.pending += change * change;
                if (!contact.soft) out.penetration = maximum(-contact.surface.distance, out.penetration);
                add_at_sample<R>(t, c.scratch.gradient.data(), s, terms.gradient);
                if constexpr (want == Want::forces_and_matrix)
                    add_sample_block<R>(t, c.scratch.blocks.data(), s, terms.curvature);
            }
            if (c.slots[slot].body >= 0) {
                store_vec3<R>(&c.exchange.slot_gradient[3 * i * W], terms.gradient);
                store_mat3<R>(&c.exchange.slot_curvature[9 * i * W], terms.curvature);
            } else if (!contact.idle) {
                add_vec3<R>(&c.scratch.sample_gradient[3 * s * W], terms.gradient);
                if constexpr (want == Want::forces_and_matrix)
                    add_block<R>(c.scratch.sample_curvature.data(), int(s), terms.curvature);
            }
            store<R>(&c.scratch.normal_candidate[i * W], terms.normal_force);
            if (contact.friction) {
                const Vec3<R> dt = terms.tangential - contact.state.tangential_multiplier;
                const R dr = friction * terms.normal_force - contact.state.friction_radius;
                out.pending += dot(dt, dt) + dr * dr;
                store_vec3<R>(&c.scratch.tangential_candidate[3 * i * W],
                              transposed_times(frame.rotation, terms.tangential));
                // The gradient of a smoothed mesh is not quite of length one; the tangent plane needs it to be.
                const R length = maximum(norm(contact.local_normal), R(T(1e-6)));
                store_vec3<R>(&c.scratch.contact_normal[3 * i * W], (R(1) / length) * contact.local_normal);
            }
        }
    }
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
    if (with_matrix) std::fill(c.scratch.blocks.begin(), c.scratch.blocks.end(), T(0));
    Evaluation<R> out;
    out.extent = load<R>(c.rest.extent.data());
    detail::add_tissue<want>(c, exactness, out);
    if (settings.inertia) detail::add_inertia<want>(c, T(1 / (settings.dt * settings.dt)), out);
    detail::add_bone_springs<want>(c, out);
    detail::add_contacts<want>(c, exactness, out);
    const Mat3<R> turning = detail::carry_forces_to_bone<R>(c);
    if (with_matrix) {
        detail::carry_stiffness_to_bone<R>(c);
        detail::add_block<R>(c.scratch.blocks.data(), c.topology->diagonal_block[c.topology->bone_rotation],
                             exactness * turning);
    }
    for (int i : c.topology->unknowns) {
        const Vec3<R> g = load_vec3<R>(&c.scratch.gradient[3 * i * W]);
        out.residual += dot(g, g);
    }
    if (c.limits.met) detail::add_pending_of_limits(c, out);
    return out;
}

}  // namespace palpate
