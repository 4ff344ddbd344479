#pragma once
// Contact of one sample with the objects in one slot, which may be another one in each lane.

#include <algorithm>

#include "engine/contact/contact_terms.h"
#include "engine/math/gather.h"
#include "engine/skin/chunks/samples.h"
#include "engine/skin/solve/fitted.h"

namespace palpate::detail {

/// A slot as a kernel reads it: whether and how its objects touch, and where they are at the end of the step.
template <class R>
struct Slot {
    int index = 0;
    const ContactSlot* lanes = nullptr;
    bool rubs, all_here, any_soft, any_body, all_body;
    MaskOf<R> here, soft, body;
    R friction;
    Vec3<R> size;
    R round;
    Mat3<R> rotation;
    Vec3<R> position;
    const ScalarOf<R>* start = nullptr;  ///< rotation 3x3 and position at the start of the step: friction asks for them

    /// What is the bodies' of a term, and what is not.
    Vec3<R> of_bodies(const Vec3<R>& v) const { return all_body ? v : select(body, v, Vec3<R>{R(0), R(0), R(0)}); }
    Mat3<R> of_bodies(const Mat3<R>& m) const { return all_body ? m : select(body, m, Mat3<R>::zero()); }
    Vec3<R> of_others(const Vec3<R>& v) const { return any_body ? select(body, Vec3<R>{R(0), R(0), R(0)}, v) : v; }
    Mat3<R> of_others(const Mat3<R>& m) const { return any_body ? select(body, Mat3<R>::zero(), m) : m; }
};

template <class R>
inline Slot<R> read_slot(const SkinChunk<ScalarOf<R>>& c, int index) {
    using T = ScalarOf<R>;
    constexpr int W = lane_width<R>;
    const auto& w = c.scratch;
    const ContactSlot& lanes = c.contacts.slot[std::size_t(index)];
    const T* frame = &w.slot_frame[24 * std::size_t(index) * W];
    Slot<R> s;
    s.index = index;
    s.lanes = &lanes;
    s.rubs = lanes.friction;
    s.all_here = lanes.lanes == (1u << W) - 1;
    s.any_soft = lanes.soft_lanes != 0;
    s.any_body = lanes.body_lanes != 0;
    s.all_body = s.any_body && lanes.body_lanes == lanes.lanes;
    s.here = load<R>(&w.slot_kind[std::size_t(index) * W]) >= R(T(0));
    s.soft = load<R>(&w.slot_stiffness[std::size_t(index) * W]) > R(T(0));
    s.body = load<R>(&w.slot_body[std::size_t(index) * W]) > R(T(0));
    s.friction = load<R>(&w.slot_friction[std::size_t(index) * W]);
    s.size = load_vec3<R>(&w.slot_size[3 * std::size_t(index) * W]);
    s.round = load<R>(&w.slot_round[std::size_t(index) * W]);
    s.rotation = load_mat3<R>(frame);
    s.position = load_vec3<R>(frame + 9 * W);
    s.start = frame + 12 * W;
    return s;
}

/// Distance and normal of the meshes of one slot, every lane by itself. `sample` counts samples over all slots.
template <class R>
inline SurfacePoint<R> mesh_points(const SkinChunk<ScalarOf<R>>& c, int slot, std::size_t sample, const Vec3<R>& x) {
    using T = ScalarOf<R>;
    constexpr int W = lane_width<R>;
    alignas(64) T values[4 * W] = {};
    const unsigned lanes = c.contacts.slot[std::size_t(slot)].of_kind[std::size_t(ShapeKind::mesh)];
    for (int l = 0; l < W; ++l) {
        if (!((lanes >> l) & 1u)) continue;
        const Shape& shape = c.contacts.at(slot, l).shape;
        const Vec3<double> at{double(lane(x.x, l)), double(lane(x.y, l)), double(lane(x.z, l))};
        const double side = double(c.state.contact_side[sample * W + std::size_t(l)]);
        const MeshPoint p = side >= covered_mesh ? foot_point(shape, at, side, mesh_contact_distance)
                                                 : mesh_contact_distance(*shape.mesh, at);
        values[l] = T(p.distance);
        values[W + l] = T(p.normal.x), values[2 * W + l] = T(p.normal.y), values[3 * W + l] = T(p.normal.z);
    }
    return {load<R>(values), {load<R>(values + W), load<R>(values + 2 * W), load<R>(values + 3 * W)}};
}

template <class R>
inline bool lanes_recover(const Slot<R>& slot) {
    return slot.lanes->recovers;
}

/// Distance and normal of the slot's objects at x, which is in their frames; a metre away where a lane has none.
/// `sample` counts samples over all slots.
template <class R>
inline SurfacePoint<R> slot_surface(const SkinChunk<ScalarOf<R>>& c, const Slot<R>& slot, std::size_t sample,
                                    const Vec3<R>& x) {
    using T = ScalarOf<R>;
    const ContactSlot& lanes = *slot.lanes;
    SurfacePoint<R> nearest{R(T(1)), {R(T(0)), R(T(0)), R(T(1))}};
    for (int k = 0; k < shape_kind_count; ++k) {
        const unsigned here = lanes.of_kind[std::size_t(k)];
        if (here == 0) continue;
        const ShapeKind kind = ShapeKind(k);
        const SurfacePoint<R> p =
            kind == ShapeKind::mesh ? mesh_points<R>(c, slot.index, sample, x)
            : has_sides(kind)
                ? sided_point(kind, slot.size, slot.round, x, load<R>(&c.state.contact_side[sample * lane_width<R>]))
                : primitive_point(kind, slot.size, x);
        if (slot.all_here && here == lanes.lanes) return p;
        const R of_lane = load<R>(&c.scratch.slot_kind[std::size_t(slot.index) * lane_width<R>]);
        const MaskOf<R> mine = absolute(of_lane - R(T(k))) < R(T(0.5));
        nearest.distance = select(mine, p.distance, nearest.distance);
        nearest.normal = select(mine, p.normal, nearest.normal);
    }
    return nearest;
}

/// Where a sample is to the objects in a slot.
template <class R>
struct SampleSurface {
    Vec3<R> local;            ///< the sample, in their frames
    SurfacePoint<R> surface;  ///< normal in these; distance as contact counts it
};

/// The distance that contact counts: less what recovers, and what curved skin is nearer.
template <class R>
inline R counted_distance(const SkinChunk<ScalarOf<R>>& c, const Slot<R>& slot, std::size_t s, R distance) {
    const std::size_t i = std::size_t(slot.index) * c.topology->sample_count() + s;
    if (lanes_recover(slot)) distance -= load<R>(&c.state.contact_offset[i * lane_width<R>]);
    if (!c.scratch.rise.empty()) distance -= rise_at_sample<R>(c, slot.index, s);
    if (s >= c.topology->samples.size() && (c.fine_lanes & c.used_lanes) != c.used_lanes)
        distance = select(mask_from_bits<R>(c.fine_lanes), distance, R(ScalarOf<R>(1)));
    return distance;
}

template <class R>
inline SampleSurface<R> sample_surface(const SkinChunk<ScalarOf<R>>& c, const Slot<R>& slot, std::size_t s,
                                       const Vec3<R>& x) {
    SampleSurface<R> out;
    out.local = transposed_times(slot.rotation, x - slot.position);
    out.surface = slot_surface(c, slot, std::size_t(slot.index) * c.topology->sample_count() + s, out.local);
    out.surface.distance = counted_distance(c, slot, s, out.surface.distance);
    return out;
}

/// How many samples are looked at together: of a finger alone as many as fill a register.
template <class R>
struct SamplesTogether {
    using type = R;
    static constexpr int count = 1;
};
template <class R>
requires(lane_width<R> == 1 && shares_register<R>) struct SamplesTogether<R> {
    using type = typename WholeRegister<R>::type;
    static constexpr int count = lane_width<type>;
};
template <class R>
inline constexpr int samples_together = SamplesTogether<R>::count;

/// sample_surface of `count` samples of a finger alone, from `first` on, which are at x, side by side in a register.
/// All but meshes.
template <class R>
inline void find_primitive_surfaces(const SkinChunk<ScalarOf<R>>& c, const Slot<R>& slot, ShapeKind kind,
                                    std::size_t first, int count, const Vec3<R>* x, SampleSurface<R>* out) {
    using T = ScalarOf<R>;
    using Q = typename SamplesTogether<R>::type;
    const T* sides = &c.state.contact_side[std::size_t(slot.index) * c.topology->sample_count() + first];
    Vec3<Q> at{Q(0), Q(0), Q(0)};
    Q side(0);
    for (int k = 0; k < count; ++k) {
        for (int d = 0; d < 3; ++d) set_lane(at[d], k, lane(x[k][d], 0));
        set_lane(side, k, sides[k]);
    }
    auto repeat = [](const Vec3<R>& v) {
        return Vec3<Q>{repeat_part<Q>(v.x), repeat_part<Q>(v.y), repeat_part<Q>(v.z)};
    };
    Mat3<Q> rotation;
    for (int i = 0; i < 9; ++i) rotation.m[i / 3][i % 3] = repeat_part<Q>(slot.rotation.m[i / 3][i % 3]);
    const Vec3<Q> local = transposed_times(rotation, at - repeat(slot.position));
    const SurfacePoint<Q> surface = has_sides(kind)
                                        ? sided_point(kind, repeat(slot.size), repeat_part<Q>(slot.round), local, side)
                                        : primitive_point(kind, repeat(slot.size), local);
    for (int k = 0; k < count; ++k) {
        auto part = [&](const Vec3<Q>& v) { return Vec3<R>{R(lane(v.x, k)), R(lane(v.y, k)), R(lane(v.z, k))}; };
        const R distance = counted_distance(c, slot, first + std::size_t(k), R(lane(surface.distance, k)));
        out[k] = {part(local), {distance, part(surface.normal)}};
    }
}

/// sample_surface of `count` samples from `first` on, which are at x.
template <class R>
inline void find_sample_surfaces(const SkinChunk<ScalarOf<R>>& c, const Slot<R>& slot, std::size_t first, int count,
                                 const Vec3<R>* x, SampleSurface<R>* out) {
    if constexpr (samples_together<R> != 1) {
        const auto& kinds = slot.lanes->of_kind;
        const auto kind = ShapeKind(
            std::find_if(kinds.begin(), kinds.end(), [](unsigned lanes) { return lanes != 0; }) - kinds.begin());
        if (slot.all_here && kind != ShapeKind::mesh) {
            find_primitive_surfaces(c, slot, kind, first, count, x, out);
            return;
        }
    }
    for (int k = 0; k < count; ++k) out[k] = sample_surface(c, slot, first + std::size_t(k), x[k]);
}

/// One sample against one slot's objects. Slip is how far the sample moved over the object in this step, measured
/// in the object's frame: where the object turns, friction turns with it, and the potential depends on where the two
/// are relative to each other alone, so that action equals reaction.
template <class R>
struct SampleContact {
    SurfacePoint<R> surface;
    Vec3<R> local_normal;  ///< object's frame
    ContactState<R> state;
    bool idle;  ///< touches in no lane, nor did at the last multiplier update: all terms are zero, and left out
    ContactTerms<R> terms;
};
template <class R>
inline SampleContact<R> sample_contact(const SkinChunk<ScalarOf<R>>& c, const Slot<R>& slot, std::size_t s,
                                       const SampleSurface<R>& at, const R& exactness) {
    using T = ScalarOf<R>;
    constexpr int W = lane_width<R>;
    const std::size_t i = std::size_t(slot.index) * c.topology->sample_count() + s;
    const Vec3<R> zero{R(0), R(0), R(0)};
    SampleContact<R> out;
    out.surface = at.surface;
    out.local_normal = out.surface.normal;
    out.state = {load<R>(&c.state.normal_multiplier[i * W]), zero, R(0), zero};
    // Where nodes stick and slide by turns, Newton cycles about the kink between the two if friction is much stiffer
    // than tissue; creep is not a matter of the penalty, its multiplier takes it away.
    const R base = load<R>(&c.rest.contact_penalty[s * W]), scale = load<R>(&c.state.penalty_scale[W]);
    const R k_slip = base * minimum(scale, R(T(fitted::stiffest_slip)));
    R k = base * scale;
    if (slot.any_soft) {  // the force of what gives way is what its depth makes it, and no multiplier
        out.state.normal_multiplier = select(slot.soft, R(T(0)), out.state.normal_multiplier);
        const R stiffness = load<R>(&c.scratch.slot_stiffness[std::size_t(slot.index) * W]);
        k = select(slot.soft, stiffness * load<R>(&c.rest.contact_area[s * W]), k);
    }
    MaskOf<R> idle = (out.state.normal_multiplier <= R(0)) & (k * out.surface.distance >= R(0));
    Vec3<R> tangential = zero;
    if (slot.rubs) {
        out.state.friction_radius = load<R>(&c.state.friction_radius[i * W]);
        tangential = load_vec3<R>(&c.state.tangential_multiplier[3 * i * W]);
        idle = idle & (out.state.friction_radius <= R(0)) & (dot(tangential, tangential) <= R(0));
    }
    out.idle = all(idle);
    if (out.idle) {
        out.terms = {R(0), zero, Mat3<R>::zero(), R(0), zero};
        return out;
    }
    out.surface.normal = slot.rotation * out.local_normal;
    Vec3<R> slip = zero;
    if (slot.rubs) {
        out.state.tangential_multiplier = slot.rotation * tangential;
        out.state.friction_normal = slot.rotation * load_vec3<R>(&c.state.friction_normal[3 * i * W]);
        const Vec3<R> before = at_sample<R>(*c.topology, c.scratch.start_position.data(), s);
        slip = slot.rotation *
               (at.local - transposed_times(load_mat3<R>(slot.start), before - load_vec3<R>(slot.start + 9 * W)));
    }
    out.terms = contact_terms(out.surface, slip, k, k_slip, out.state, slot.rubs, exactness);
    if (slot.any_soft)  // nothing of it is pending
        out.state.normal_multiplier = select(slot.soft, out.terms.normal_force, out.state.normal_multiplier);
    return out;
}

}  // namespace palpate::detail
