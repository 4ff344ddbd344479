#include "engine/bodies/prepare_bodies.h"

#include <algorithm>

#include "engine/bodies/islands.h"

namespace palpate {

void prepare_bodies(World& world) {
    BodySolve& s = world.body_solve;
    const std::size_t objects = world.shapes.size(), bodies = world.bodies.size();
    const std::size_t chunks = std::size_t(world.chunks.count());
    if (bodies == 0) return;
    for (const VirtualObject& shape : world.shapes) {
        s.features.push_back(features_of(shape.shape, false));
        s.plane_features.push_back(features_of(shape.shape, true));
        double reach = shape.shape.kind == ShapeKind::plane ? 1e9 : 0;
        const Vec3<double> centre = shape.body < 0 ? Vec3<double>{0, 0, 0} : world.bodies[shape.body].mass_centre;
        for (const auto* features : {&s.features.back(), &s.plane_features.back()})
            for (const Feature& f : *features) reach = std::max(reach, norm(f.point - centre) + f.radius);
        s.reach.push_back(reach);
        if (shape.body >= 0) world.bodies[shape.body].size = reach;
    }
    s.objects.resize(objects);
    s.near_objects.reserve(objects);
    s.first_pair.assign(objects + 1, 0);
    s.wanted_pairs.assign(objects, 0);
    for (std::size_t a = 0; a < objects; ++a)
        for (std::size_t b = 0; b < objects; ++b) {
            const VirtualObject &of_a = world.shapes[a], &of_b = world.shapes[b];
            if (a == b || (of_a.body < 0 && of_b.body < 0)) continue;
            const double away = surface_point(of_b.shape, of_b.pose, of_a.pose.position).distance;
            s.wanted_pairs[a] += away < s.reach[a] + 1e-3;
        }
    grow_pairs(s, 6);
    s.bodies.resize(bodies);
    reserve_islands(s, int(bodies), int(chunks));
}

namespace {

/// Scenes of so many fingers are played in real time: they have the memory for touching each other from the start. Of
/// more, those that come near have it then.
constexpr std::size_t most_with_room = 16;

}  // namespace

void prepare_finger_pairs(const SceneSpec& spec, World& world) {
    FingerPairs& pairs = world.finger_pairs;
    const std::size_t fingers = spec.fingers.size();
    pairs.on = spec.fingers_touch && fingers > 1;
    pairs.friction = spec.skin_friction;
    if (!pairs.on) return;
    if (fingers <= most_with_room) {
        const std::size_t near = std::min(fingers * (fingers - 1) / 2, 2 * fingers);
        pairs.near.reserve(near);
        std::size_t samples = 0;
        world.chunks.for_each([&](auto& c) {
            make_room_for_fingers(c, pairs.friction > 0);
            samples = std::max(samples, c.topology->sample_count());
        });
        pairs.samples.reserve(2 * samples);
    }
    pairs.reach.resize(fingers);
    pairs.slot.resize(fingers);
    for (std::size_t i = 0; i < fingers; ++i) pairs.order.push_back(int(i));
    pairs.before.reserve(std::min(fingers * (fingers - 1) / 2, 8 * fingers));
    std::size_t pad = 0;
    for (const FingerSpec& f : spec.fingers) pad = std::max(pad, f.mesh.pad_nodes.size() + 1);
    pairs.pad_a.reserve(pad), pairs.pad_b.reserve(pad);
}

void prepare_touching_fingers(World& world) {
    const std::size_t near = world.finger_pairs.near.capacity();
    if (near > 0) reserve_islands(world.body_solve, int(world.bodies.size() + near), world.chunks.count());
}

}  // namespace palpate
