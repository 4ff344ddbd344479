// Fingers move between the lanes of alike chunks, so that those that are solved share few of them.

#include <algorithm>
#include <array>

#include "engine/skin/chunks/fields.h"

namespace palpate {

namespace {

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

/// Where all fingers are alike, and share these numbers, nothing is to be done.
template <class T>
void exchange(RestArray<T>& a, int width_a, int lane_a, RestArray<T>& b, int width_b, int lane_b, bool both) {
    const std::size_t count = a.size() / std::size_t(width_a);
    bool same = true;
    for (std::size_t i = 0; i < count && same; ++i)
        same = a[i * std::size_t(width_a) + std::size_t(lane_a)] == b[i * std::size_t(width_b) + std::size_t(lane_b)];
    if (same) return;
    a.own(), b.own();
    for (std::size_t i = 0; i < count; ++i) {
        T& of_a = a[i * std::size_t(width_a) + std::size_t(lane_a)];
        T& of_b = b[i * std::size_t(width_b) + std::size_t(lane_b)];
        const T old = of_b;
        of_b = of_a;
        if (both) of_a = old;
    }
}

void exchange_bit(unsigned& a, int lane_a, unsigned& b, int lane_b) {
    const unsigned of_a = (a >> lane_a) & 1u, of_b = (b >> lane_b) & 1u;
    a = (a & ~(1u << lane_a)) | (of_b << lane_a);
    b = (b & ~(1u << lane_b)) | (of_a << lane_b);
}

}  // namespace

template <class T>
SkinChunk<T> spare_chunk(const SkinChunk<T>& like, int width) {
    SkinChunk<T> c;
    c.material = like.material;
    c.has_soft_objects = like.has_soft_objects;
    c.keeps_matrix = like.keeps_matrix;
    c.own_frictions = like.own_frictions;
    c.linear.pairs = like.linear.pairs;
    allocate_chunk(c, like.topology, width, like.has_limits, like.has_friction, like.contacts.capacity, like.has_bodies,
                   like.has_membranes);
    // Lanes without a finger repeat one that has, so that their arithmetic stays finite.
    for_each_field_of_both(c, const_cast<SkinChunk<T>&>(like), [&](auto& to, const auto& from, const Field& f) {
        if (f.owner != Owner::lane || !stays_with_finger(f)) return;
        for (std::size_t i = 0; i < to.size(); ++i) to[i] = from[i / std::size_t(width) * std::size_t(like.width)];
    });
    c.limits.unloaded = c.limits.candidates_clear = true;
    return c;
}

template <class T>
bool alike(const SkinChunk<T>& a, const SkinChunk<T>& b) {
    return a.topology == b.topology && a.material == b.material && a.has_limits == b.has_limits &&
           a.has_membranes == b.has_membranes && a.has_friction == b.has_friction && a.has_bodies == b.has_bodies &&
           a.has_soft_objects == b.has_soft_objects && a.own_frictions == b.own_frictions &&
           a.linear.pairs.empty() == b.linear.pairs.empty();
}

template <class T>
void exchange_lanes(SkinChunk<T>& a, int lane_a, SkinChunk<T>& b, int lane_b) {
    const bool both =
        (b.used_lanes >> lane_b) & 1u;  // an empty lane of a is left with numbers that can be reckoned with
    const bool keeps = a.keeps_matrix || b.keeps_matrix;  // one of them may have made no step yet
    for (SkinChunk<T>* c : {&a, &b}) {
        if (c->keeps_matrix == keeps) continue;
        c->keeps_matrix = keeps;
        if (c->shared_work >= 0) resize_fields(*c);
    }
    for_each_field_of_both(a, b, [&](auto& of_a, auto& of_b, const Field& f) {
        if (f.owner == Owner::lane && stays_with_finger(f))
            exchange(of_a, a.width, lane_a, of_b, b.width, lane_b, both);
    });
    move_contacts(a, lane_a, b, lane_b);
    for (int i = 0; i < 9; ++i) std::swap(a.still_spring[i * a.width + lane_a], b.still_spring[i * b.width + lane_b]);
    std::swap(a.finger[lane_a], b.finger[lane_b]);
    std::swap(a.status[lane_a], b.status[lane_b]);
    std::swap(a.skin_mass[lane_a], b.skin_mass[lane_b]);
    std::swap(a.skin_inertia[lane_a], b.skin_inertia[lane_b]);
    std::swap(a.free_steps[lane_a], b.free_steps[lane_b]);
    std::swap(a.coarse_steps[lane_a], b.coarse_steps[lane_b]);
    std::swap(a.rest_reach[lane_a], b.rest_reach[lane_b]);
    std::swap(a.reach[lane_a], b.reach[lane_b]);
    for (auto bits : {&SkinChunk<T>::used_lanes, &SkinChunk<T>::asleep_lanes, &SkinChunk<T>::rigid_lanes,
                      &SkinChunk<T>::unchanged_lanes, &SkinChunk<T>::fine_lanes, &SkinChunk<T>::linear_lanes,
                      &SkinChunk<T>::soft_lanes})
        exchange_bit(a.*bits, lane_a, b.*bits, lane_b);
    std::swap(a.linear.plan[lane_a], b.linear.plan[lane_b]);
    for (auto bits : {&LinearTissue<T>::due_lanes, &LinearTissue<T>::kept_lanes})
        exchange_bit(a.linear.*bits, lane_a, b.linear.*bits, lane_b);
    for (auto* columns : {&a.scratch.changed_columns, &b.scratch.changed_columns})  // factors stay behind
        std::fill(columns->begin(), columns->end(), 1);
    a.limits.unloaded = b.limits.unloaded = a.limits.unloaded && b.limits.unloaded;
    a.limits.counted = b.limits.counted = false;
}

#define PALPATE_INSTANTIATE(T)                                     \
    template SkinChunk<T> spare_chunk(const SkinChunk<T>&, int);   \
    template bool alike(const SkinChunk<T>&, const SkinChunk<T>&); \
    template void exchange_lanes(SkinChunk<T>&, int, SkinChunk<T>&, int);
PALPATE_INSTANTIATE(double)
PALPATE_INSTANTIATE(float)
#undef PALPATE_INSTANTIATE

}  // namespace palpate
