#include "scenes/run/carry_over.h"

#include <algorithm>

#include "engine/skin/chunks/fields.h"
#include "engine/skin/chunks/level_of_detail.h"
#include "scenes/run/hardware.h"

namespace palpate {

namespace {

template <class T>
bool alike(const std::vector<SkinChunk<T>>& a, const std::vector<SkinChunk<T>>& b) {
    return std::equal(a.begin(), a.end(), b.begin(), b.end(), [](const auto& x, const auto& y) {
        return x.width == y.width && x.used_lanes == y.used_lanes && x.topology->elements == y.topology->elements &&
               x.topology->samples == y.topology->samples && x.finger == y.finger;
    });
}

/// Puts the fingers of a fresh world into the lanes that they have moved to in the other.
template <class T>
void rearrange(const World& like, const std::vector<SkinChunk<T>>& model, World& fresh,
               std::vector<SkinChunk<T>>& chunks) {
    if (chunks.size() != model.size() || like.skins.size() != fresh.skins.size()) return;
    for (std::size_t i = 0; i < fresh.skins.size(); ++i) {
        const Skin& there = like.skins[i];
        Skin& here = fresh.skins[i];
        if (there.single_precision != here.single_precision || here.single_precision != (sizeof(T) == 4)) continue;
        if (there.chunk == here.chunk && there.lane == here.lane) continue;
        SkinChunk<T>&from = chunks[std::size_t(here.chunk)], &to = chunks[std::size_t(there.chunk)];
        if (there.lane >= to.width || !alike(from, to)) return;
        exchange_lanes(from, here.lane, to, there.lane);
        if (const int other = from.finger[std::size_t(here.lane)]; other >= 0)
            fresh.skins[std::size_t(other)].chunk = here.chunk, fresh.skins[std::size_t(other)].lane = here.lane;
        here.chunk = there.chunk, here.lane = there.lane;
    }
}

/// Soft objects keep what they are pressed with; their chunks are carried as fingers' are.
void carry_soft(const SoftObjects& from, SoftObjects& to) {
    for (std::size_t k = 0; k < to.all.size(); ++k) {
        const Coupling& a = from.all[k].hold;
        Coupling& b = to.all[k].hold;
        b.target = a.target, b.last_target = a.last_target, b.started = a.started;
    }
    for (std::size_t k = 0; k < to.pairs.size(); ++k)
        if (from.pairs[k].samples.size() == to.pairs[k].samples.size()) to.pairs[k].samples = from.pairs[k].samples;
}

bool alike(const Simulation& a, const Simulation& b) {
    const World &u = a.world, &v = b.world;
    if (!alike(u.chunks.doubles, v.chunks.doubles) || !alike(u.chunks.floats, v.chunks.floats)) return false;
    if (u.soft.all.size() != v.soft.all.size() || u.soft.pairs.size() != v.soft.pairs.size()) return false;
    if (u.shapes.size() != v.shapes.size() || u.bodies.size() != v.bodies.size() ||
        u.pose_filters.size() != v.pose_filters.size() ||
        u.body_solve.first_pair.size() != v.body_solve.first_pair.size())
        return false;
    for (std::size_t i = 0; i < u.shapes.size(); ++i) {
        const VirtualObject &x = u.shapes[i], &y = v.shapes[i];
        const bool moves = x.body >= 0 || x.held_body >= 0, would_move = y.body >= 0 || y.held_body >= 0;
        if (x.shape.kind != y.shape.kind || x.soft != y.soft || moves != would_move) return false;
    }
    return std::equal(u.matchings.begin(), u.matchings.end(), v.matchings.begin(), v.matchings.end(),
                      [](const Matching& x, const Matching& y) {
                          return x.finger == y.finger && same_device(x.model, y.model) && x.force_mode == y.force_mode;
                      });
}

template <class T>
void carry_chunks(std::vector<SkinChunk<T>>& from, std::vector<SkinChunk<T>>& to) {
    for (std::size_t k = 0; k < from.size(); ++k) {
        soften_lanes(from[k], from[k].rigid_lanes);
        to[k].limits = {};
        to[k].keeps_matrix = from[k].keeps_matrix;
        to[k].contacts = from[k].contacts;
        resize_fields(to[k]);
        // Arrays that one of them has not are those of friction or limits, which were just switched.
        for_each_field_of_both(from[k], to[k], [](const auto& a, auto& b, const Field& f) {
            if (f.role == Role::state && a.size() == b.size()) b = a;
        });
        to[k].status = from[k].status;  // the next step begins by it
        // Shapes of meshes are those of the new objects; detect_contacts puts them in.
        for (LaneContact& contact : to[k].contacts.lane_contact) contact.shape = {};
    }
}

/// Whether the scene of `now` places an object elsewhere than that of `before` did.
bool placed_elsewhere(const Simulation& before, const Simulation& now, std::size_t object) {
    const auto &a = before.scene.spec.objects, &b = now.scene.spec.objects;
    if (object >= a.size() || object >= b.size()) return false;
    return norm(a[object].pose.position - b[object].pose.position) > 0 ||
           norm(a[object].pose.rotation.vector() - b[object].pose.rotation.vector()) > 0;
}

/// Fingers that are no longer to touch each other let go.
void part_fingers(World& w) {
    w.chunks.for_each([](auto& c) {
        for (int lane = 0; lane < c.width; ++lane)
            for (int slot = c.contacts.count[std::size_t(lane)]; slot-- > 0;)
                if (c.contacts.at(slot, lane).finger >= 0) erase_contact(c, lane, slot);
    });
}

}  // namespace

bool carry_over(Simulation& from, Simulation& to) {
    World &u = from.world, &v = to.world;
    rearrange(u, u.chunks.doubles, v, v.chunks.doubles);
    rearrange(u, u.chunks.floats, v, v.chunks.floats);
    if (!alike(from, to)) return false;
    // Armed ones are driven by threads of their own, and simulated servos have a past: neither changes on the way.
    if (from.hardware ? !same_thimbles(from, to) : from.scene.servo != to.scene.servo) return false;
    v.time = u.time, v.step = u.step;
    carry_chunks(u.chunks.doubles, v.chunks.doubles);
    carry_chunks(u.chunks.floats, v.chunks.floats);
    v.tracker_poses = u.tracker_poses;
    for (std::size_t i = 0; i < u.couplings.size(); ++i) {
        const Coupling& a = u.couplings[i];
        Coupling& b = v.couplings[i];
        b.target = a.target, b.last_target = a.last_target, b.started = a.started, b.slowed = a.slowed;
    }
    for (std::size_t i = 0; i < u.shapes.size(); ++i) {
        const VirtualObject& a = u.shapes[i];
        VirtualObject& b = v.shapes[i];
        const bool goes_there = a.body < 0 && placed_elsewhere(from, to, i);  // what forces move goes on where it is
        if (!goes_there) b.pose = a.pose;
        b.previous = a.previous, b.body = a.body, b.held_body = a.held_body;
    }
    for (std::size_t i = 0; i < u.bodies.size(); ++i) {
        const RigidBody& a = u.bodies[i];
        RigidBody& b = v.bodies[i];
        b.velocity = a.velocity, b.angular_momentum = a.angular_momentum, b.acceleration = a.acceleration;
        b.gripped = a.gripped;
        b.contact_force = a.contact_force, b.contact_torque = a.contact_torque;
        b.asleep = a.asleep && v.time < b.release;  // others look again where they are
    }
    if (v.finger_pairs.on)
        v.finger_pairs.near = u.finger_pairs.near, v.finger_pairs.before = u.finger_pairs.before;
    else
        part_fingers(v);
    carry_soft(u.soft, v.soft);
    v.body_solve.pairs = u.body_solve.pairs;
    v.body_solve.first_pair = u.body_solve.first_pair;
    for (std::size_t i = 0; i < u.matchings.size(); ++i) {
        const Matching& a = u.matchings[i];
        Matching& b = v.matchings[i];
        b.result = a.result, b.geometric = a.geometric, b.next = a.next, b.solves = a.solves;
        b.q = a.q, b.torque = a.torque, b.force_N = a.force_N;
        v.device_links[i].mailbox = &from.loops[i]->mailbox;
        v.device_links[i].retreat = u.device_links[i].retreat, v.device_links[i].retreats = u.device_links[i].retreats;
    }
    for (std::size_t t = 0; t < from.loops.size() && !from.hardware; ++t) {
        ThimbleLoop& loop = *from.loops[t];
        ThimbleLoop& fresh = *to.loops[t];
        loop.settings = fresh.settings, loop.model = fresh.model, loop.rest_q = fresh.rest_q;
        loop.largest_torque = fresh.largest_torque, loop.moving_torque = fresh.moving_torque;
    }
    to.loops = std::move(from.loops);
    to.hardware = std::move(from.hardware);
    to.live = from.live;
    to.pace = from.pace;
    return true;
}

}  // namespace palpate
