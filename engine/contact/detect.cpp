#include <algorithm>
#include <atomic>
#include <bit>
#include <cmath>

#include "engine/contact/fitted.h"
#include "engine/systems.h"

namespace palpate {

namespace {

/// Sphere around the samples of one lane, with how far it may travel in this step added.
template <class T>
Sphere lane_reach(const SkinChunk<T>& c, int lane, const SolverSettings& solver) {
    const int W = c.width;
    const SkinTopology& t = *c.topology;
    // The bone is drawn to its targets; the skin follows, and swings with its own speed.
    double travel2 = 0;
    for (int s = 0; s < bone_spring_count; ++s) {
        Vec3<double> d;
        for (int k = 0; k < 3; ++k)
            d[k] = c.scratch.bone_springs[(9 * s + 2 + k) * W + lane] - double(c.state.bone[k * W + lane]);
        travel2 = std::max(travel2, dot(d, d));
    }
    const double travel = std::sqrt(travel2);
    if ((c.rigid_lanes >> lane) & 1u) {
        auto rate = [&](int i) { return double(c.state.bone_velocity[i * W + lane]); };
        const double turning = norm(Vec3<double>{rate(3), rate(4), rate(5)}) * double(c.rest.extent[lane]);
        const double speed = norm(Vec3<double>{rate(0), rate(1), rate(2)}) + turning;
        const Sphere& rest = c.rest_reach[lane];
        return {transform(lane_bone(c, lane), rest.centre), rest.radius + 2e-3 + 2 * travel + 2 * speed * solver.dt};
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
    return {0.5 * (low + high), norm(half) + 2e-3 + 2 * travel + 2 * std::sqrt(speed2) * solver.dt};
}

/// Radius of a sphere around an object's origin that holds its surface [m].
double bound_of(const Shape& shape) {
    switch (shape.kind) {
        case ShapeKind::box:
            return norm(shape.size);
        case ShapeKind::sphere:
            return shape.size.x;
        case ShapeKind::capsule:
            return shape.size.x + shape.size.y;
        case ShapeKind::cylinder:
            return std::hypot(shape.size.x, shape.size.y);
        case ShapeKind::plane:
        case ShapeKind::mesh:
            break;
    }
    return HUGE_VAL;
}

/// Whether an object, which may itself come nearer by `approach`, is within reach.
bool is_near(const VirtualObject& shape, double approach, const Sphere& reach) {
    const Vec3<double> apart = reach.centre - shape.pose.position;
    const double within = bound_of(shape.shape) + reach.radius + approach;
    if (dot(apart, apart) > within * within) return false;
    return surface_point(shape.shape, shape.pose, reach.centre).distance - reach.radius - approach < 0;
}

/// Radius of an object's edges for a skin that wants so much [m].
double rounding_of(const Shape& shape, double wanted) {
    if (!(wanted > 0) || !has_sides(shape.kind)) return 0;
    const double least = std::min(shape.size.x, shape.size.y);
    return std::min(wanted, fitted::roundest * (shape.kind == ShapeKind::box ? std::min(least, shape.size.z) : least));
}

/// Of a box, a plane, or something long, the part that one finger may touch, with an origin near it: in single
/// precision places on a table are known no better than to a rounding of how far off its origin is (0.45 m away half
/// the steps did not converge, 4.5 m away forces were off by 0.04 N).
void keep_near_part(LaneContact& contact, const Sphere& reach) {
    const Vec3<double> at_end = inverse_transform(contact.pose, reach.centre),
                       at_start = inverse_transform(contact.start, reach.centre), middle = 0.5 * (at_end + at_start);
    const double kept = 2 * (reach.radius + norm(at_end - at_start)) + fitted::least_near_part;
    Shape& shape = contact.shape;
    Vec3<double> origin{0, 0, 0};
    auto shorten = [&](double& half, double& place, double off) {
        if (!(half > kept)) return;
        place = std::clamp(off, kept - half, half - kept);
        half = kept;
    };
    if (shape.kind == ShapeKind::plane) origin = {middle.x, middle.y, 0};
    if (shape.kind == ShapeKind::box)
        for (int d = 0; d < 3; ++d) shorten(shape.size[d], origin[d], middle[d]);
    if (shape.kind == ShapeKind::capsule || shape.kind == ShapeKind::cylinder)
        shorten(shape.size.y, origin.z, middle.z);
    for (Pose<double>* pose : {&contact.pose, &contact.start}) pose->position = transform(*pose, origin);
}

template <class T>
LaneContact contact_of(const SkinChunk<T>& c, int lane, const VirtualObject& shape, int object,
                       const Table<RigidBody>& bodies) {
    LaneContact contact{object,         shape.shape,     shape.pose, shape.previous,
                        shape.friction, shape.stiffness, shape.body, {}};
    const auto& own = c.rest.object_friction;
    if (!own.empty()) contact.friction = double(own[std::size_t(object * c.width + lane)]);
    contact.shape.round = rounding_of(shape.shape, c.edge_round);
    if (shape.body >= 0) contact.mass_centre = bodies[std::size_t(shape.body)].mass_centre;
    return contact;
}

/// Fills the slots of one lane, in the order of the objects. An object keeps its multipliers for as long as it is near.
template <class T>
int detect_for_lane(const Table<VirtualObject>& shapes, const Table<RigidBody>& bodies, const SolverSettings& solver,
                    SkinChunk<T>& c, int lane) {
    int slot = 0, growths = 0;
    for (int object = 0; object < int(shapes.size()); ++object) {
        const VirtualObject& shape = shapes[std::size_t(object)];
        if (shape.soft >= 0) continue;  // its skin is touched (detect_soft.cpp)
        const double approach =
            shape.body < 0 ? 0 : 2 * solver.dt * norm(bodies[std::size_t(shape.body)].velocity) + farthest_fall(solver);
        const bool was_near = slot < c.contacts.count[std::size_t(lane)] && c.contacts.at(slot, lane).object == object;
        if (!is_near(shape, approach, c.reach[std::size_t(lane)])) {
            if (was_near) erase_contact(c, lane, slot);
            continue;
        }
        LaneContact contact = contact_of(c, lane, shape, object, bodies);
        if (sizeof(T) < sizeof(double) && shape.body < 0) keep_near_part(contact, c.reach[std::size_t(lane)]);
        if (was_near) {
            LaneContact& kept = c.contacts.at(slot, lane);
            contact.leapt = kept.leapt, contact.behind = kept.behind;
            kept = contact;
        } else {
            growths += insert_contact(c, lane, slot, contact), c.contacts.at(slot, lane).fresh = true;
        }
        ++slot;
    }
    return growths;
}

template <class T>
int detect_for_chunk(const Table<VirtualObject>& shapes, const Table<RigidBody>& bodies, const SolverSettings& solver,
                     SkinChunk<T>& c) {
    int growths = 0;
    for (int lane = 0; lane < c.width; ++lane) {
        if (!((c.used_lanes >> lane) & 1u)) continue;
        // A finger that sleeps, and is to stay where it is, reaches as far as before.
        if (!(((c.unchanged_lanes >> lane) & 1u) && same_target(c, lane)))
            c.reach[std::size_t(lane)] = lane_reach(c, lane, solver);
        growths += detect_for_lane(shapes, bodies, solver, c, lane);
    }
    return growths;
}

}  // namespace

int detect_contacts(const Table<VirtualObject>& shapes, const Table<RigidBody>& bodies, const SolverSettings& solver,
                    Threads& threads, SkinChunks& chunks) {
    std::atomic<int> growths = 0;
    auto detect = [&](int chunk) {
        growths += chunks.with(chunk, [&](auto& c) { return detect_for_chunk(shapes, bodies, solver, c); });
    };
    constexpr int few = 48;  // fingers, which one thread has done before others are woken
    int fingers = 0;
    chunks.for_each([&](const auto& c) { fingers += std::popcount(c.used_lanes); });
    if (fingers >= few)
        threads.for_each(chunks.count(), detect);
    else
        for (int chunk = 0; chunk < chunks.count(); ++chunk) detect(chunk);
    return growths;
}

}  // namespace palpate
