#pragma once
// Start and end of a chunk's implicit step, and what its iteration does to lanes in between: they move along a
// direction, multipliers are updated, penalties stiffen, and lanes that are lost are put to rest.

#include <limits>
#include <tuple>

#include "engine/skin/solve/curved_skin.h"
#include "engine/skin/solve/evaluate.h"
#include "engine/skin/solve/progress.h"

namespace palpate::detail {

/// Bone nodes go where the bone is.
template <class R>
inline void place_bone_nodes(SkinChunk<ScalarOf<R>>& c) {
    constexpr int W3 = 3 * lane_width<R>;
    const Pose<R> bone = load_pose<R>(c.state.bone.data());
    const Mat3<R> rotation = rotation_matrix(bone.rotation);
    for (int i : c.topology->bone_nodes)
        store_vec3<R>(&c.state.position[i * W3],
                      bone.position + rotation * load_vec3<R>(&c.rest.rest_position[i * W3]));
}

/// Of the given lanes, those whose first guess is not to be taken: an element, or a patch, is too far beyond its
/// limits, or velocities are of a step that ended off balance by more than a share of its contact force.
template <class R>
inline unsigned lanes_not_to_coast(const SkinChunk<ScalarOf<R>>& c, unsigned lanes, const SolverSettings& settings,
                                   double roughest) {
    using T = ScalarOf<R>;
    constexpr int W = lane_width<R>;
    if (!settings.inertia || !c.has_limits) return lanes;
    unsigned past = 0;
    for (int l = 0; l < W; ++l)
        if (!(c.status[l].residual_N <= roughest * c.status[l].contact_force_N)) past |= lanes & (1u << l);
    const R less(T(1 - fitted::coasting_excess)), more(T(1 + fitted::coasting_excess));
    const std::size_t elements = c.topology->elements.size();
    for (std::size_t limit = 0; limit < c.topology->limit_count() && (lanes & ~past) != 0; ++limit) {
        const R low = less * load<R>(&c.rest.limit_low[limit * W]),
                high = more * load<R>(&c.rest.limit_high[limit * W]);
        const Mat3<R> F =
            limit < elements ? element_deformation<R>(c, limit) : patch_deformation<R>(c, limit - elements);
        past |= bits_from_mask<R>(!is_within_limits(F, low, high)) & lanes;
    }
    return past;
}

/// Targets of implicit Euler, the first guess, and multipliers carried along with the bone's turn. `roughest`: share of
/// the contact force by which a step may have ended off balance for skin at its limits to coast on.
template <class R>
inline void begin_step(SkinChunk<ScalarOf<R>>& c, const SolverSettings& settings,
                       double roughest = std::numeric_limits<double>::infinity()) {
    using T = ScalarOf<R>;
    constexpr int W = lane_width<R>;
    const SkinTopology& t = *c.topology;
    const R dt = R(settings.inertia ? T(settings.dt) : T(0));
    c.scratch.start_position = c.state.position;
    c.scratch.start_bone = c.state.bone;
    if (!t.skin_edges.empty() && near_lanes(c) != 0)
        find_bulges<R>(c);
    else if (near_sides(c))
        find_skin_normals<R>(c);
    begin_slots(c, settings);
    const Pose<R> before = load_pose<R>(c.state.bone.data());
    const Quaternion<R> turn = rotation_step(dt * load_vec3<R>(&c.state.bone_velocity[3 * W]));
    const Pose<R> bone{before.position + dt * load_vec3<R>(c.state.bone_velocity.data()),
                       normalised(turn * before.rotation)};
    store_pose<R>(c.state.bone.data(), bone);
    const Mat3<R> rotation = rotation_matrix(turn);
    // Penalties fall back once they are not needed, which under limits cannot be foreseen; but those of contacts must
    // not stay where rounding of positions makes more force than a few millionths of what they carry.
    unsigned limited = 0, stiff = 0;
    for (int l = 0; l < W; ++l) {
        if (c.status[l].limited_elements == 0) continue;
        limited |= 1u << l;
        if (c.rest.contact_penalty.empty()) continue;
        const double rounding = std::numeric_limits<T>::epsilon() * double(c.rest.extent[l]) *
                                double(c.rest.contact_penalty[l]) * double(c.state.penalty_scale[W + l]);
        if (rounding > fitted::felt_rounding * c.status[l].contact_force_N) stiff |= 1u << l;
    }
    const MaskOf<R> active = mask_from_bits<R>(active_lanes(c));
    const MaskOf<R> at_limits = mask_from_bits<R>(limited), kept[2] = {at_limits, mask_from_bits<R>(limited & ~stiff)};
    for (int k = 0; k < 2; ++k) {
        T* scale = &c.state.penalty_scale[k * W];
        const R old = load<R>(scale);
        store<R>(scale, select(active, maximum(select(kept[k], R(1), R(T(fitted::fall_back))) * old, R(1)), old));
    }
    // The first guess: nodes coast on. Where elements are at their limits, that may carry them far past: there the skin
    // moves with the bone as it is.
    for (int i = 0; i < t.node_count; ++i) {
        T* p = &c.state.position[3 * i * W];
        const Vec3<R> coasting = load_vec3<R>(p) + dt * load_vec3<R>(&c.state.velocity[3 * i * W]);
        store_vec3<R>(&c.scratch.inertia_target[3 * i * W], coasting);
        store_vec3<R>(p, coasting);
    }
    place_bone_nodes<R>(c);
    if (const unsigned past = lanes_not_to_coast<R>(c, limited, settings, roughest); past != 0) {
        const MaskOf<R> rigid = mask_from_bits<R>(past);
        for (int i = 0; i < t.node_count; ++i) {
            T* p = &c.state.position[3 * i * W];
            const Vec3<R> x = load_vec3<R>(&c.scratch.start_position[3 * i * W]);
            store_vec3<R>(p, select(rigid, bone.position + rotation * (x - before.position), load_vec3<R>(p)));
        }
        place_bone_nodes<R>(c);
    }
    if (!c.has_limits || c.limits.unloaded) return;
    for (std::size_t e = 0; e < t.limit_count(); ++e) {
        if (c.limits.counted && c.scratch.loaded_limits[e] == 0) continue;
        T* p = &c.state.limit_multiplier[9 * e * W];
        R largest(0);
        for (int i = 0; i < 9; ++i) largest = maximum(absolute(load<R>(p + i * W)), largest);
        const unsigned loaded = bits_from_mask<R>(largest > R(0));
        c.scratch.loaded_limits[e] = std::uint16_t(loaded);
        if (loaded != 0) store_mat3<R>(p, rotation * load_mat3<R>(p));
    }
    c.limits.counted = true;
}

/// Linear tissue evaluates limits of watched elements alone: those of others bear nothing.
template <class R>
inline void clear_unwatched_candidates(SkinChunk<ScalarOf<R>>& c) {
    constexpr int W = lane_width<R>;
    const MaskOf<R> linear = mask_from_bits<R>(c.linear_lanes);
    for (std::size_t e = 0; e < c.topology->limit_count(); ++e) {
        const MaskOf<R> unwatched = linear & (load<R>(&c.linear.watched[e * W]) <= R(0));
        clear_candidate<R>(c, e, bits_from_mask<R>(unwatched));
    }
}

/// Copies the candidates of the last evaluation into the multipliers of the masked lanes.
template <class R>
inline void update_multipliers(SkinChunk<ScalarOf<R>>& c, MaskOf<R> lanes) {
    using T = ScalarOf<R>;
    constexpr int W = lane_width<R>;
    auto take = [&](LaneArray<T>& to, const LaneArray<T>& from, std::size_t begin, std::size_t count) {
        for (std::size_t i = begin * W; i < (begin + count) * W; i += W)
            store<R>(&to[i], select(lanes, load<R>(&from[i]), load<R>(&to[i])));
    };
    if (c.has_limits && !(c.limits.unloaded && c.limits.candidates_clear)) {
        if (c.linear_lanes != 0) clear_unwatched_candidates<R>(c);
        const unsigned bits = bits_from_mask<R>(lanes);
        for (std::size_t e = 0; e < c.topology->limit_count(); ++e) {
            std::uint16_t& loaded = c.scratch.loaded_limits[e];
            const unsigned now = c.scratch.candidate_limits[e];
            if (((loaded | now) & bits) == 0) continue;
            take(c.state.limit_multiplier, c.scratch.limit_candidate, 9 * e, 9);
            loaded = std::uint16_t((loaded & ~bits) | (now & bits));
        }
        const bool of_all = (bits & c.used_lanes) == c.used_lanes;
        c.limits.unloaded = (of_all || c.limits.unloaded) && c.limits.candidates_clear;
    }
    const std::size_t S = c.topology->sample_count();
    for (int slot = 0; slot < c.contacts.used; ++slot) {
        take(c.state.normal_multiplier, c.scratch.normal_candidate, slot * S, S);
        if (!c.contacts.slot[std::size_t(slot)].friction) continue;
        const R friction = load<R>(&c.scratch.slot_friction[std::size_t(slot) * W]);
        take(c.state.tangential_multiplier, c.scratch.tangential_candidate, 3 * slot * S, 3 * S);
        take(c.state.friction_normal, c.scratch.contact_normal, 3 * slot * S, 3 * S);
        for (std::size_t i = slot * S * W; i < (slot + 1) * S * W; i += W) {
            const R radius = friction * load<R>(&c.scratch.normal_candidate[i]);
            store<R>(&c.state.friction_radius[i], select(lanes, radius, load<R>(&c.state.friction_radius[i])));
        }
    }
}

/// base <- current position in the masked lanes.
template <class R>
inline void keep_base(SkinChunk<ScalarOf<R>>& c, MaskOf<R> lanes) {
    constexpr int W = lane_width<R>;
    for (std::size_t i = 0; i < c.state.position.size(); i += W)
        store<R>(&c.scratch.base_position[i],
                 select(lanes, load<R>(&c.state.position[i]), load<R>(&c.scratch.base_position[i])));
    for (std::size_t i = 0; i < c.state.bone.size(); i += W)
        store<R>(&c.scratch.base_bone[i], select(lanes, load<R>(&c.state.bone[i]), load<R>(&c.scratch.base_bone[i])));
}

/// position <- base + alpha direction in the masked lanes; the bone turns by a rotation step.
template <class R>
inline void move_from_base(SkinChunk<ScalarOf<R>>& c, MaskOf<R> lanes, const R& alpha) {
    constexpr int W = lane_width<R>;
    const SkinTopology& t = *c.topology;
    for (std::size_t u = 0; u + 2 < t.unknowns.size(); ++u) {
        const int i = t.unknowns[u];
        auto* x = &c.state.position[3 * i * W];
        const Vec3<R> moved =
            load_vec3<R>(&c.scratch.base_position[3 * i * W]) + alpha * load_vec3<R>(&c.scratch.direction[3 * i * W]);
        store_vec3<R>(x, select(lanes, moved, load_vec3<R>(x)));
    }
    const Pose<R> base = load_pose<R>(c.scratch.base_bone.data()), old = load_pose<R>(c.state.bone.data());
    const Vec3<R> dp = load_vec3<R>(&c.scratch.direction[3 * t.bone_position * W]);
    const Vec3<R> dr = load_vec3<R>(&c.scratch.direction[3 * t.bone_rotation * W]);
    const Quaternion<R> q = normalised(rotation_step(alpha * dr) * base.rotation);
    Pose<R> pose;
    pose.position = select(lanes, base.position + alpha * dp, old.position);
    pose.rotation = {select(lanes, q.w, old.rotation.w), select(lanes, q.x, old.rotation.x),
                     select(lanes, q.y, old.rotation.y), select(lanes, q.z, old.rotation.z)};
    store_pose<R>(c.state.bone.data(), pose);
    place_bone_nodes<R>(c);
}

/// Puts the lanes that the step leaves out back where they were: whether their neighbours are solved makes no
/// difference to them. Decompositions of the others become the next step's first guesses.
template <class R>
inline void restore_inactive(SkinChunk<ScalarOf<R>>& c) {
    using T = ScalarOf<R>;
    auto restore = [&](LaneArray<T>& to, const LaneArray<T>& from, unsigned solved) {
        if (solved == c.used_lanes) return;
        const MaskOf<R> kept = mask_from_bits<R>(solved);
        for (std::size_t i = 0; i < to.size(); i += lane_width<R>)
            store<R>(&to[i], select(kept, load<R>(&to[i]), load<R>(&from[i])));
    };
    restore(c.state.position, c.scratch.start_position, active_lanes(c));
    restore(c.state.bone, c.scratch.start_bone, active_lanes(c));
    // Corotational and linear tissue decompose nothing.
    const unsigned decomposed = active_lanes(c) & ~c.linear_lanes;
    if (decomposed == 0 || c.scratch.svd.empty()) return;
    restore(c.scratch.svd, c.state.svd_guess, decomposed);
    std::swap(c.state.svd_guess, c.scratch.svd);
}

/// Velocities of implicit Euler from the accepted positions.
template <class R>
inline void end_step(SkinChunk<ScalarOf<R>>& c, const SolverSettings& settings) {
    using T = ScalarOf<R>;
    constexpr int W = lane_width<R>;
    const R rate = R(settings.inertia ? T(1 / settings.dt) : T(0));
    restore_inactive<R>(c);
    for (std::size_t i = 0; i < c.state.position.size(); i += W)
        store<R>(&c.state.velocity[i], rate * (load<R>(&c.state.position[i]) - load<R>(&c.scratch.start_position[i])));
    const MaskOf<R> active = mask_from_bits<R>(active_lanes(c));
    const Pose<R> now = load_pose<R>(c.state.bone.data()), before = load_pose<R>(c.scratch.start_bone.data());
    T *linear = c.state.bone_velocity.data(), *angular = &c.state.bone_velocity[3 * W];
    store_vec3<R>(linear, select(active, rate * (now.position - before.position), load_vec3<R>(linear)));
    const Quaternion<R> turn = now.rotation * conjugate(before.rotation);
    // Inverse of rotation_step: omega dt = 2 v / w.
    const R w = maximum(absolute(turn.w), R(T(0.1)));
    store_vec3<R>(angular, select(active, (rate / w) * shorter_twice_vector(turn), load_vec3<R>(angular)));
}

/// Puts the masked lanes to rest on the target of their coupling, without multipliers.
template <class R>
inline void reset_lanes(SkinChunk<ScalarOf<R>>& c, MaskOf<R> lanes) {
    using T = ScalarOf<R>;
    constexpr int W = lane_width<R>;
    const SkinTopology& t = *c.topology;
    const Pose<R> target = load_pose<R>(&c.scratch.bone_springs[2 * W]);
    const Pose<R> old = load_pose<R>(c.state.bone.data());
    Pose<R> pose;
    pose.position = select(lanes, target.position, old.position);
    for (auto [to, a, b] : {std::tuple{&pose.rotation.w, target.rotation.w, old.rotation.w},
                            std::tuple{&pose.rotation.x, target.rotation.x, old.rotation.x},
                            std::tuple{&pose.rotation.y, target.rotation.y, old.rotation.y},
                            std::tuple{&pose.rotation.z, target.rotation.z, old.rotation.z}})
        *to = select(lanes, a, b);
    store_pose<R>(c.state.bone.data(), pose);
    for (int i = 0; i < t.node_count; ++i) {
        T* x = &c.state.position[3 * i * W];
        const Vec3<R> rest = transform(pose, load_vec3<R>(&c.rest.rest_position[3 * i * W]));
        store_vec3<R>(x, select(lanes, rest, load_vec3<R>(x)));
    }
    auto clear = [&](LaneArray<T>& a) {
        for (std::size_t i = 0; i < a.size(); i += W) store<R>(&a[i], select(lanes, R(0), load<R>(&a[i])));
    };
    for (auto* a : {&c.state.velocity, &c.state.bone_velocity, &c.state.limit_multiplier, &c.state.normal_multiplier,
                    &c.state.tangential_multiplier, &c.state.friction_radius, &c.scratch.limit_candidate,
                    &c.scratch.normal_candidate, &c.scratch.tangential_candidate})
        clear(*a);
    for (T* scale : {&c.state.penalty_scale[0], &c.state.penalty_scale[W]})
        store<R>(scale, select(lanes, R(1), load<R>(scale)));
    for (std::size_t i = 0; i < c.scratch.svd.size() / W; ++i)
        store<R>(&c.scratch.svd[i * W], select(lanes, R(i % 9 % 4 == 0 ? T(1) : T(0)), load<R>(&c.scratch.svd[i * W])));
}

/// Lanes with a node so far from the bone that no finger could still be meant: they have diverged.
template <class R>
inline MaskOf<R> lost_lanes(const SkinChunk<ScalarOf<R>>& c) {
    constexpr int W3 = 3 * lane_width<R>;
    const Vec3<R> bone = load_vec3<R>(c.state.bone.data());
    R farthest(0);
    for (int i = 0; i < c.topology->node_count; ++i) {
        const Vec3<R> d = load_vec3<R>(&c.state.position[i * W3]) - bone;
        farthest = maximum(dot(d, d), farthest);
    }
    const R reach = R(ScalarOf<R>(fitted::lost_at)) * load<R>(c.rest.extent.data());
    return !MaskOf<R>(farthest <= reach * reach);
}

/// Lanes whose skin has been tangled for too long: far beyond its limits, and far from equilibrium with anything that
/// pulls at it. Skin wound around itself (after a start in a random state; nothing that a finger can do leads there)
/// cannot come free without turning elements inside out, and swings for ever.
template <class R>
inline MaskOf<R> tangled_lanes(SkinChunk<ScalarOf<R>>& c, const Evaluation<R>& e, MaskOf<R> converged) {
    using T = ScalarOf<R>;
    const R pull = R(T(fitted::tangled_pull)) * maximum(maximum(e.contact_force, e.coupling_force), R(1));
    const MaskOf<R> tangled =
        (!converged) & (e.violation > R(T(fitted::tangled_violation))) & (e.residual > pull * pull);
    R steps = select(tangled, load<R>(c.state.tangled_steps.data()) + R(1), R(0));
    const MaskOf<R> lost = steps > R(T(fitted::tangled_steps));
    store<R>(c.state.tangled_steps.data(), select(lost, R(0), steps));
    return lost;
}

/// Adds the lanes' damping to the diagonal of the Newton matrix.
template <class R>
inline void damp(SkinChunk<ScalarOf<R>>& c, MaskOf<R> lanes, const R& damping) {
    if (!any(lanes & (damping > R(0)))) return;
    const R own = select(lanes, damping * load<R>(c.rest.tissue_stiffness.data()), R(0));
    const Mat3<R> block = own * Mat3<R>::identity();
    for (std::size_t u = 0; u + 2 < c.topology->unknowns.size(); ++u)
        add_block<R>(c.scratch.blocks.data(), c.topology->diagonal_block[c.topology->unknowns[u]], block);
    std::fill(c.scratch.changed_columns.begin(), c.scratch.changed_columns.end(), 1);
}

/// Force that rounding of positions makes [N]: no residual can be asked to be below it.
template <class R>
inline R rounding_force(const SkinChunk<ScalarOf<R>>& c, const Evaluation<R>& e) {
    using T = ScalarOf<R>;
    constexpr int W = lane_width<R>;
    constexpr double epsilon = std::numeric_limits<T>::epsilon();
    R stiffness = load<R>(c.rest.rounding_stiffness.data());
    for (int s = 0; s < bone_spring_count; ++s) stiffness += load<R>(&c.scratch.bone_springs[9 * s * W]);
    const R extent = load<R>(c.rest.extent.data()), unit = R(T(fitted::position_roundings * epsilon));
    const R force = unit * extent * stiffness;
    if (c.rest.contact_penalty.empty()) return force;
    // Where samples are on an object is rounded as its origin is far, too.
    R far = extent;
    if constexpr (sizeof(T) < sizeof(double))
        for (int l = 0; l < W; ++l)
            for (int slot = 0; slot < c.contacts.count[std::size_t(l)]; ++slot) {
                const double away = norm(lane_bone(c, l).position - c.contacts.at(slot, l).pose.position);
                set_lane(far, l, std::max(lane(far, l), T(away)));
            }
    const R penalty = load<R>(c.rest.contact_penalty.data()) * load<R>(&c.state.penalty_scale[W]);
    return force + select(e.contact_force > R(0), unit * far * penalty, R(0));
}

template <class R>
inline void record_status(SkinChunk<ScalarOf<R>>& c, const SolverSettings& settings, const Evaluation<R>& e,
                          const LaneProgress<R>& p, unsigned reset) {
    const unsigned converged = bits_from_mask<R>(p.converged);
    for (int l = 0; l < lane_width<R>; ++l) {
        if (!((active_lanes(c) >> l) & 1u)) continue;
        Evaluation<double> of_lane;
        of_lane.residual = double(lane(e.residual, l));
        of_lane.violation = double(lane(e.violation, l));
        of_lane.penetration = double(lane(e.penetration, l));
        of_lane.contact_force = double(lane(e.contact_force, l));
        of_lane.limited = double(lane(e.limited, l));
        LaneProgress<double> progress;
        progress.iterations = double(lane(p.iterations, l));
        progress.updates = double(lane(p.updates, l));
        progress.backtracks = double(lane(p.backtracks, l));
        progress.uphill = double(lane(p.uphill, l));
        progress.budget = double(lane(p.budget, l));
        progress.extra = double(lane(p.extra, l));
        progress.converged = (converged >> l) & 1u;
        c.status[std::size_t(l)] = status_of<R>(of_lane, progress, settings, (reset >> l) & 1u);
    }
}

/// The end of the iteration: lanes that failed, or whose skin is lost or wound around itself, are put to rest; the
/// others keep the forces they have found as multipliers. Returns the bits of the former.
template <class R>
inline unsigned end_iteration(SkinChunk<ScalarOf<R>>& c, const Evaluation<R>& e, MaskOf<R> solved, MaskOf<R> failed,
                              MaskOf<R> converged) {
    const MaskOf<R> reset = solved & (failed | lost_lanes<R>(c) | tangled_lanes<R>(c, e, converged | !solved));
    const unsigned lanes = bits_from_mask<R>(reset);
    if (lanes != 0) {
        leave_linear_tissue(c, lanes);
        reset_lanes<R>(c, reset);
    }
    update_multipliers<R>(c, solved & !reset);
    return lanes;
}

/// Multipliers that shrink a violation too little from one update to the next get a stiffer penalty (fitted.h).
template <class R>
inline void stiffen_slow_lanes(SkinChunk<ScalarOf<R>>& c, const SolverSettings& s, const Evaluation<R>& e,
                               MaskOf<R> lanes, R& last_excess, R& last_depth) {
    using T = ScalarOf<R>;
    const R largest(T(sizeof(T) == 8 ? fitted::stiffest_double : fitted::stiffest_float));
    const MaskOf<R> near =
        lanes & (e.violation < R(T(fitted::far_beyond_limits))) & (e.penetration < R(T(fitted::deep_in_skin)));
    auto stiffen = [&](T* of, const R& most, const R& excess, R& last) {
        const R scale = load<R>(of);
        const MaskOf<R> slow = near & (excess > R(1)) & (R(T(fitted::fast_enough)) * excess > last) & (scale < most);
        store<R>(of, select(slow, R(T(fitted::stiffer)) * scale, scale));
        last = select(lanes, excess, last);
    };
    const R violation = e.violation * R(T(1 / s.limit_tolerance)),
            depth = e.penetration * R(T(1 / s.contact_tolerance));
    // Contacts that settle slowly press on elements at their limits, so those become stiffer, too; in float that would
    // make more force of rounding than it is worth.
    stiffen(&c.state.penalty_scale[0], largest, sizeof(T) == 8 ? maximum(violation, depth) : violation, last_excess);
    stiffen(&c.state.penalty_scale[lane_width<R>], largest, depth, last_depth);
}

}  // namespace palpate::detail
