// Fingers move between the lanes of alike chunks, so that those that are solved share few of them.

#include <algorithm>
#include <array>

#include "engine/skin/chunk.h"

namespace palpate {

namespace {

/// Everything of a lane but its contacts, and but what the next solve writes anew.
template <class Chunk>
auto lane_arrays(Chunk& c) {
    auto& r = c.rest;
    auto& s = c.state;
    auto& w = c.scratch;
    auto& l = c.linear;
    return std::array{&r.shape_gradients,
                      &r.volume,
                      &r.mu,
                      &r.lambda,
                      &r.limit_low,
                      &r.limit_high,
                      &r.limit_penalty,
                      &r.mass,
                      &r.contact_penalty,
                      &r.contact_area,
                      &r.object_friction,
                      &r.tissue_stiffness,
                      &r.rounding_stiffness,
                      &r.extent,
                      &r.rest_position,
                      &s.position,
                      &s.velocity,
                      &s.bone,
                      &s.bone_velocity,
                      &s.limit_multiplier,
                      &s.svd_guess,
                      &s.tangled_steps,
                      &s.penalty_scale,
                      &w.bone_springs,
                      &w.gradient,
                      &l.weight,
                      &l.frame,
                      &l.arm,
                      &l.force,
                      &l.blocks,
                      &l.energy,
                      &l.watched,
                      &l.reach,
                      &l.bound,
                      &l.error};
}

template <class T>
struct SlotArray {
    LaneArray<T>* values;
    int per_sample;
};
template <class T>
std::array<SlotArray<T>, 4> slot_arrays(SkinChunk<T>& c) {
    return {{{&c.state.normal_multiplier, 1},
             {&c.state.tangential_multiplier, 3},
             {&c.state.friction_radius, 1},
             {&c.state.friction_normal, 3}}};
}

template <class T>
void exchange(LaneArray<T>& a, int width_a, int lane_a, LaneArray<T>& b, int width_b, int lane_b, bool both) {
    const std::size_t count = a.size() / std::size_t(width_a);
    T* p = a.data() + lane_a;
    T* q = b.data() + lane_b;
    for (std::size_t i = 0; i < count; ++i, p += width_a, q += width_b) {
        const T old = *q;
        *q = *p;
        if (both) *p = old;
    }
}

/// For each slot of a that is near the lane, a slot of b for the same object: kept, or fresh. False where b has none.
template <class T>
bool find_slots(const SkinChunk<T>& a, int lane, const SkinChunk<T>& b, std::array<int, max_contact_slots>& to) {
    unsigned taken = 0;
    for (int slot = 0; slot < a.slot_capacity; ++slot) {
        to[slot] = -1;
        const ContactSlot& s = a.slots[slot];
        if (s.object < 0 || !((s.near_lanes >> lane) & 1u)) continue;
        for (const bool same : {true, false})
            for (int k = 0; k < b.slot_capacity && to[slot] < 0; ++k)
                if (b.slots[k].object == (same ? s.object : -1) && !((taken >> k) & 1u)) to[slot] = k;
        if (to[slot] < 0) return false;
        taken |= 1u << to[slot];
    }
    return true;
}

template <class T>
void move_contacts(SkinChunk<T>& a, int lane_a, SkinChunk<T>& b, int lane_b,
                   const std::array<int, max_contact_slots>& to) {
    const std::size_t S = a.topology->sample_count();
    const auto of_a = slot_arrays(a), of_b = slot_arrays(b);
    for (int slot = 0; slot < a.slot_capacity; ++slot) {
        if (to[slot] < 0) continue;
        ContactSlot &from = a.slots[slot], &into = b.slots[to[slot]];
        if (into.object < 0) into = from, into.near_lanes = 0;
        into.friction = std::max(into.friction, from.friction);
        into.near_lanes |= 1u << lane_b;
        from.near_lanes &= ~(1u << lane_a);
        for (std::size_t k = 0; k < of_a.size(); ++k) {
            if (of_a[k].values->empty()) continue;
            const std::size_t count = S * std::size_t(of_a[k].per_sample);
            T* p = of_a[k].values->data() + std::size_t(slot) * count * a.width + lane_a;
            T* q = of_b[k].values->data() + std::size_t(to[slot]) * count * b.width + lane_b;
            for (std::size_t i = 0; i < count; ++i) q[i * b.width] = p[i * a.width], p[i * a.width] = T(0);
        }
        if (from.near_lanes == 0) from = {};
    }
}

void exchange_bit(unsigned& a, int lane_a, unsigned& b, int lane_b) {
    const unsigned of_a = (a >> lane_a) & 1u, of_b = (b >> lane_b) & 1u;
    a = (a & ~(1u << lane_a)) | (of_b << lane_a);
    b = (b & ~(1u << lane_b)) | (of_a << lane_b);
}

}  // namespace

template <class T>
SkinChunk<T> spare_chunk(const SkinChunk<T>& like, int width, int object_count, bool has_bodies) {
    SkinChunk<T> c;
    allocate_chunk(c, like.topology, width, like.has_limits, like.has_friction, object_count, has_bodies);
    c.material = like.material;
    if (!like.linear.pairs.empty()) allocate_linear_tissue(c);
    auto& model = const_cast<SkinChunk<T>&>(like);
    const auto of_model = lane_arrays(model), of_spare = lane_arrays(c);
    // Lanes without a finger repeat one that has, so that their arithmetic stays finite.
    auto repeat = [&](auto& to, const auto& from) {
        const std::size_t count = from.size() / std::size_t(like.width);
        to.resize(count * std::size_t(width));
        for (std::size_t i = 0; i < to.size(); ++i) to[i] = from[i / std::size_t(width) * std::size_t(like.width)];
    };
    for (std::size_t k = 0; k < of_spare.size(); ++k) repeat(*of_spare[k], *of_model[k]);
    repeat(c.state.origin, like.state.origin);
    c.limits.unloaded = c.limits.candidates_clear = true;
    return c;
}

template <class T>
bool alike(const SkinChunk<T>& a, const SkinChunk<T>& b) {
    return a.topology == b.topology && a.material == b.material && a.has_limits == b.has_limits &&
           a.has_friction == b.has_friction && a.slot_capacity == b.slot_capacity &&
           a.linear.pairs.empty() == b.linear.pairs.empty() &&
           a.rest.contact_area.empty() == b.rest.contact_area.empty() &&
           a.rest.object_friction.empty() == b.rest.object_friction.empty();
}

template <class T>
bool exchange_lanes(SkinChunk<T>& a, int lane_a, SkinChunk<T>& b, int lane_b) {
    std::array<int, max_contact_slots> to;
    if (!find_slots(a, lane_a, b, to)) return false;
    const bool both =
        (b.used_lanes >> lane_b) & 1u;  // an empty lane of a is left with numbers that can be reckoned with
    const auto of_a = lane_arrays(a), of_b = lane_arrays(b);
    for (std::size_t k = 0; k < of_a.size(); ++k) exchange(*of_a[k], a.width, lane_a, *of_b[k], b.width, lane_b, both);
    exchange(a.state.origin, a.width, lane_a, b.state.origin, b.width, lane_b, both);
    move_contacts(a, lane_a, b, lane_b, to);
    for (int i = 0; i < 9; ++i) std::swap(a.still_spring[i * a.width + lane_a], b.still_spring[i * b.width + lane_b]);
    std::swap(a.finger[lane_a], b.finger[lane_b]);
    std::swap(a.status[lane_a], b.status[lane_b]);
    std::swap(a.skin_mass[lane_a], b.skin_mass[lane_b]);
    std::swap(a.skin_inertia[lane_a], b.skin_inertia[lane_b]);
    std::swap(a.calm_steps[lane_a], b.calm_steps[lane_b]);
    std::swap(a.coarse_steps[lane_a], b.coarse_steps[lane_b]);
    std::swap(a.rest_reach[lane_a], b.rest_reach[lane_b]);
    std::swap(a.reach[lane_a], b.reach[lane_b]);
    for (auto bits : {&SkinChunk<T>::used_lanes, &SkinChunk<T>::asleep_lanes, &SkinChunk<T>::rigid_lanes,
                      &SkinChunk<T>::unchanged_lanes, &SkinChunk<T>::fine_lanes, &SkinChunk<T>::linear_lanes})
        exchange_bit(a.*bits, lane_a, b.*bits, lane_b);
    std::swap(a.linear.plan[lane_a], b.linear.plan[lane_b]);
    for (auto bits : {&LinearTissue<T>::due_lanes, &LinearTissue<T>::kept_lanes})
        exchange_bit(a.linear.*bits, lane_a, b.linear.*bits, lane_b);
    a.limits.unloaded = b.limits.unloaded = a.limits.unloaded && b.limits.unloaded;
    return true;
}

#define PALPATE_INSTANTIATE(T)                                              \
    template SkinChunk<T> spare_chunk(const SkinChunk<T>&, int, int, bool); \
    template bool alike(const SkinChunk<T>&, const SkinChunk<T>&);          \
    template bool exchange_lanes(SkinChunk<T>&, int, SkinChunk<T>&, int);
PALPATE_INSTANTIATE(double)
PALPATE_INSTANTIATE(float)
#undef PALPATE_INSTANTIATE

}  // namespace palpate
