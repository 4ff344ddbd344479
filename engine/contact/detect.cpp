#include <algorithm>
#include <cmath>

#include "engine/systems.h"

namespace palpate {

namespace {

/// Sphere around the samples of one lane, with the way it may go in this step added.
template <class T>
Sphere lane_reach(const SkinChunk<T>& c, int lane, const SolverSettings& solver) {
    const int W = c.width;
    const SkinTopology& t = *c.topology;
    // The bone is drawn to its targets; the skin follows, and swings with its own speed.
    double way2 = 0;
    for (int s = 0; s < bone_spring_count; ++s) {
        Vec3<double> d;
        for (int k = 0; k < 3; ++k)
            d[k] = c.scratch.bone_springs[(9 * s + 2 + k) * W + lane] - double(c.state.bone[k * W + lane]);
        way2 = std::max(way2, dot(d, d));
    }
    const double way = std::sqrt(way2);
    if ((c.rigid_lanes >> lane) & 1u) {
        auto rate = [&](int i) { return double(c.state.bone_velocity[i * W + lane]); };
        const double turning = norm(Vec3<double>{rate(3), rate(4), rate(5)}) * double(c.rest.extent[lane]);
        const double speed = norm(Vec3<double>{rate(0), rate(1), rate(2)}) + turning;
        const Sphere& rest = c.rest_reach[lane];
        return {transform(lane_bone(c, lane), rest.centre), rest.radius + 2e-3 + 2 * way + 2 * speed * solver.dt};
    }
    Vec3<double> low{1e300, 1e300, 1e300}, high{-1e300, -1e300, -1e300};
    for (int node : t.samples)
        for (int d = 0; d < 3; ++d) {
            const double x = c.state.position[(3 * node + d) * W + lane] + c.state.origin[d * W + lane];
            low[d] = std::min(low[d], x);
            high[d] = std::max(high[d], x);
        }
    double speed2 = 0;
    for (int node : t.samples) {
        Vec3<double> v;
        for (int d = 0; d < 3; ++d) v[d] = c.state.velocity[(3 * node + d) * W + lane];
        speed2 = std::max(speed2, dot(v, v));
    }
    const Vec3<double> half = 0.5 * (high - low);
    return {0.5 * (low + high), norm(half) + 2e-3 + 2 * way + 2 * std::sqrt(speed2) * solver.dt};
}

template <class T>
void clear_slot(SkinChunk<T>& c, int slot) {
    const std::size_t S = c.topology->sample_count() * c.width;
    auto clear = [&](LaneArray<T>& a, std::size_t per) {
        if (!a.empty()) std::fill(a.begin() + slot * S * per, a.begin() + (slot + 1) * S * per, T(0));
    };
    clear(c.state.normal_multiplier, 1);
    clear(c.state.tangential_multiplier, 3);
    clear(c.state.friction_radius, 1);
    clear(c.state.friction_normal, 3);
    clear(c.scratch.normal_candidate, 1);
    clear(c.scratch.tangential_candidate, 3);
    c.slots[slot] = {};
}

template <class T>
bool detect_for_chunk(const Table<RigidShape>& shapes, const Table<RigidBody>& bodies, const SolverSettings& solver,
                      SkinChunk<T>& c) {
    if (c.slot_capacity == 0) return false;
    struct Candidate {
        double distance;
        int object;
        unsigned lanes;
    };
    std::array<Candidate, max_contact_slots> near;
    // A finger that sleeps, and is to stay where it is, reaches as far as before.
    for (int lane = 0; lane < c.width; ++lane)
        if (((c.used_lanes >> lane) & 1u) && !(((c.unchanged_lanes >> lane) & 1u) && same_target(c, lane)))
            c.reach[lane] = lane_reach(c, lane, solver);
    const auto& reach = c.reach;
    int count = 0;
    bool crowded = false;
    for (int object = 0; object < int(shapes.size()); ++object) {
        const RigidShape& shape = shapes[object];
        const double way =
            shape.body < 0 ? 0 : 2 * solver.dt * norm(bodies[shape.body].velocity) + 20 * solver.dt * solver.dt;
        Candidate found{1e300, object, 0};
        for (int lane = 0; lane < c.width; ++lane) {
            if (!((c.used_lanes >> lane) & 1u)) continue;
            const double d =
                surface_point(shape.shape, shape.pose, reach[lane].centre).distance - reach[lane].radius - way;
            found.distance = std::min(found.distance, d);
            if (d < 0) found.lanes |= 1u << lane;
        }
        if (found.lanes == 0) continue;
        if (count < c.slot_capacity) {
            near[count++] = found;
            continue;
        }
        crowded = true;
        auto* farthest = std::max_element(near.begin(), near.begin() + count,
                                          [](auto& a, auto& b) { return a.distance < b.distance; });
        if (found.distance < farthest->distance) *farthest = found;
    }
    // An object keeps its slot, and with it its multipliers, for as long as it is near.
    auto is_near = [&](int object) {
        return std::any_of(near.begin(), near.begin() + count, [&](auto& n) { return n.object == object; });
    };
    for (int slot = 0; slot < c.slot_capacity; ++slot)
        if (c.slots[slot].object >= 0 && !is_near(c.slots[slot].object)) clear_slot(c, slot);
    for (int i = 0; i < count; ++i) {
        auto holds = [&](const ContactSlot& s) { return s.object == near[i].object; };
        auto slot = std::find_if(c.slots.begin(), c.slots.begin() + c.slot_capacity, holds);
        if (slot == c.slots.begin() + c.slot_capacity)
            slot = std::find_if(c.slots.begin(), c.slots.begin() + c.slot_capacity,
                                [](const ContactSlot& s) { return s.object < 0; });
        const RigidShape& shape = shapes[near[i].object];
        *slot = {near[i].object,  shape.shape, shape.pose, shape.previous, shape.friction,
                 shape.stiffness, shape.body,  {},         near[i].lanes};
        if (!c.rest.object_friction.empty())
            for (int lane = 0; lane < c.width; ++lane)
                slot->friction = std::max(slot->friction, lane_friction(c, int(slot - c.slots.begin()), lane));
        if (shape.body >= 0) slot->mass_centre = bodies[shape.body].mass_centre;
    }
    return crowded;
}

}  // namespace

int detect_contacts(const Table<RigidShape>& shapes, const Table<RigidBody>& bodies, const SolverSettings& solver,
                    std::vector<SkinChunk<double>>& double_chunks, std::vector<SkinChunk<float>>& float_chunks) {
    int crowded = 0;
    for (auto& c : double_chunks) crowded += detect_for_chunk(shapes, bodies, solver, c);
    for (auto& c : float_chunks) crowded += detect_for_chunk(shapes, bodies, solver, c);
    return crowded;
}

}  // namespace palpate
