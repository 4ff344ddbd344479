#include "scenes/run/carry_kept.h"

#include <algorithm>

#include "engine/skin/chunks/fields.h"
#include "engine/skin/chunks/level_of_detail.h"
#include "scenes/run/hardware.h"

namespace palpate {

namespace {

/// Rows of a world before, by what they are now.
struct Rows {
    const KeptRows& kept;
    std::vector<int> fingers, objects;  ///< [row before] row now; -1: gone
    std::vector<int> bodies;            ///< likewise
    Rows(const KeptRows& k, const World& before, const World& now)
        : kept(k),
          fingers(before.skins.size(), -1),
          objects(before.shapes.size(), -1),
          bodies(before.bodies.size(), -1) {
        for (std::size_t i = 0; i < k.fingers.size(); ++i)
            if (k.fingers[i] >= 0) fingers[std::size_t(k.fingers[i])] = int(i);
        for (std::size_t i = 0; i < k.objects.size(); ++i) {
            if (k.objects[i] < 0) continue;
            objects[std::size_t(k.objects[i])] = int(i);
            const int a = body_of(before.shapes[std::size_t(k.objects[i])]), b = body_of(now.shapes[i]);
            if (a >= 0) bodies[std::size_t(a)] = b;
        }
    }
    static int body_of(const VirtualObject& o) { return std::max(o.body, o.held_body); }
};

template <class T>
bool same_kind(const SkinChunk<T>& a, const SkinChunk<T>& b) {
    return a.topology->elements == b.topology->elements && a.topology->samples == b.topology->samples &&
           a.topology->node_count == b.topology->node_count && a.topology->limit_nodes == b.topology->limit_nodes;
}
template <class T>
bool same_fields(const SkinChunk<T>& a, const SkinChunk<T>& b) {
    return a.material == b.material && a.has_limits == b.has_limits && a.has_friction == b.has_friction &&
           a.has_bodies == b.has_bodies && a.has_soft_objects == b.has_soft_objects &&
           a.own_frictions == b.own_frictions && a.linear.pairs.empty() == b.linear.pairs.empty();
}

/// Contacts of a lane name objects and fingers by their rows.
template <class T>
void rename_contacts(SkinChunk<T>& c, int lane, const Rows& rows, const World& now) {
    for (int slot = c.contacts.count[std::size_t(lane)]; slot-- > 0;) {
        LaneContact& contact = c.contacts.at(slot, lane);
        if (contact.finger >= 0) {
            contact.finger = rows.fingers[std::size_t(contact.finger)];
            contact.object = contact.finger < 0 ? -1 : int(now.shapes.size()) + contact.finger;
        } else if (contact.object >= 0) {
            contact.object = rows.objects[std::size_t(contact.object)];
            if (contact.object >= 0) contact.body = now.shapes[std::size_t(contact.object)].body;
        }
        if (contact.object < 0)
            erase_contact(c, lane, slot);
        else
            contact.shape = {};  // detect_contacts puts it in
    }
}

template <class T>
void carry_finger(SkinChunk<T>& from, const Skin& was, SkinChunk<T>& to, const Skin& is, int row, const Rows& rows,
                  const World& now) {
    if (!same_kind(from, to)) return;
    const auto lane = std::size_t(is.lane), before = std::size_t(was.lane);
    if (same_fields(from, to)) {
        const auto rest = to.rest;  // material may be another one
        exchange_lanes(from, was.lane, to, is.lane);
        to.rest = rest;
        to.finger[lane] = row;
        rename_contacts(to, is.lane, rows, now);
        to.unchanged_lanes &= ~(1u << is.lane);
        return;
    }
    soften_lanes(from, from.rigid_lanes & (1u << was.lane));
    to.keeps_matrix |= from.keeps_matrix;
    for_each_field_of_both(from, to, [&](const auto& a, auto& b, const Field& f) {
        if (f.role != Role::state || f.owner != Owner::lane) return;
        const std::size_t n = a.size() / std::size_t(from.width);
        if (n != b.size() / std::size_t(to.width)) return;
        for (std::size_t i = 0; i < n; ++i)
            b[i * std::size_t(to.width) + lane] = a[i * std::size_t(from.width) + before];
    });
    to.status[lane] = from.status[before];
    to.limits = {};
}

void carry_fingers(World& u, World& v, const Rows& rows) {
    for (std::size_t i = 0; i < v.skins.size(); ++i) {
        const int k = rows.kept.fingers[i];
        if (k < 0) continue;
        const Skin &was = u.skins[std::size_t(k)], &is = v.skins[i];
        if (was.single_precision == is.single_precision) {
            const auto go = [&](auto& from, auto& to) {
                carry_finger(from[std::size_t(was.chunk)], was, to[std::size_t(is.chunk)], is, int(i), rows, v);
            };
            if (is.single_precision)
                go(u.chunks.floats, v.chunks.floats);
            else
                go(u.chunks.doubles, v.chunks.doubles);
        }
        const Coupling& a = u.couplings[std::size_t(k)];
        Coupling& b = v.couplings[i];
        b.target = a.target, b.last_target = a.last_target, b.started = a.started, b.slowed = a.slowed;
        b.force_N = a.force_N;
        *v.tracker_poses.find(b.tracker) = *u.tracker_poses.find(a.tracker);
        PoseFilter* const filter = v.pose_filters.find(b.tracker);
        if (const PoseFilter* old = u.pose_filters.find(a.tracker); filter && old) *filter = *old;
        const ContactSurface& seen = u.contact_surfaces[std::size_t(k)];
        ContactSurface& shown = v.contact_surfaces[i];
        if (seen.position.size() != shown.position.size() || seen.bulge.size() != shown.bulge.size()) continue;
        shown = seen;
        std::erase_if(shown.objects, [&](ObjectContact& c) {
            if (c.object >= 0) c.object = rows.objects[std::size_t(c.object)];
            if (c.finger >= 0) c.finger = rows.fingers[std::size_t(c.finger)];
            return c.object < 0 && c.finger < 0;
        });
    }
    const auto rename = [&](std::vector<FingerPair>& from, std::vector<FingerPair>& to) {
        to.clear();
        for (FingerPair p : from) {
            p.a = rows.fingers[std::size_t(p.a)], p.b = rows.fingers[std::size_t(p.b)];
            if (p.a >= 0 && p.b >= 0) to.push_back(p);
        }
    };
    if (!v.finger_pairs.on) return;
    rename(u.finger_pairs.near, v.finger_pairs.near);
    rename(u.finger_pairs.before, v.finger_pairs.before);
}

/// Soft objects that stay, and what kept fingers press them with.
void carry_soft(World& u, World& v, const Rows& rows) {
    std::vector<int> before(v.soft.all.size(), -1);
    for (std::size_t k = 0; k < v.soft.all.size(); ++k) {
        SoftObject& to = v.soft.all[k];
        const int object = rows.kept.objects[std::size_t(to.object)];
        before[k] = object < 0 ? -1 : u.shapes[std::size_t(object)].soft;
        if (before[k] < 0) continue;
        SoftObject& from = u.soft.all[std::size_t(before[k])];
        carry_finger(u.chunks.doubles[std::size_t(from.skin.chunk)], from.skin,
                     v.chunks.doubles[std::size_t(to.skin.chunk)], to.skin, int(v.skins.size() + k), rows, v);
        to.hold.target = from.hold.target, to.hold.last_target = from.hold.last_target;
        to.hold.started = from.hold.started;
    }
    for (SoftPair& to : v.soft.pairs)
        for (const SoftPair& from : u.soft.pairs)
            if (from.soft == before[std::size_t(to.soft)] && from.finger == rows.kept.fingers[std::size_t(to.finger)] &&
                from.samples.size() == to.samples.size())
                to.samples = from.samples;
}

void carry_objects(World& u, World& v, const Rows& rows) {
    BodySolve &s = u.body_solve, &t = v.body_solve;
    std::vector<BodyPair> pairs;
    std::vector<int> first{0};
    for (std::size_t i = 0; i < v.shapes.size(); ++i) {
        const int k = rows.kept.objects[i];
        if (k >= 0) {
            const VirtualObject& a = u.shapes[std::size_t(k)];
            VirtualObject& b = v.shapes[i];
            b.pose = a.pose, b.previous = a.previous;
            const int body = Rows::body_of(b);
            if (body >= 0 && Rows::body_of(a) >= 0) {
                b.body = a.body >= 0 ? body : -1, b.held_body = a.held_body >= 0 ? body : -1;
                const RigidBody& old = u.bodies[std::size_t(Rows::body_of(a))];
                RigidBody& now = v.bodies[std::size_t(body)];
                const RigidBody made = now;  // as the scene has it now; all else is as it was
                now = old;
                now.mass = made.mass, now.inertia = made.inertia, now.mass_centre = made.mass_centre;
                now.size = made.size, now.restitution = made.restitution, now.release = made.release;
                now.asleep = old.asleep && v.time < now.release;  // others look again at what they lie on
            }
        }
        for (int p = k < 0 || std::size_t(k) + 1 >= s.first_pair.size() ? 0 : s.first_pair[std::size_t(k)];
             k >= 0 && std::size_t(k) + 1 < s.first_pair.size() && p < s.first_pair[std::size_t(k) + 1]; ++p) {
            BodyPair pair = std::move(s.pairs[std::size_t(p)]);
            if (pair.a >= 0) pair.a = rows.objects[std::size_t(pair.a)];
            if (pair.b >= 0) pair.b = rows.objects[std::size_t(pair.b)];
            if (pair.a >= 0 && pair.b >= 0) pairs.push_back(std::move(pair));
        }
        first.push_back(int(pairs.size()));
    }
    if (v.bodies.empty() || u.bodies.empty()) return;
    t.pairs = std::move(pairs);
    t.first_pair = std::move(first);
    std::fill(t.wanted_pairs.begin(), t.wanted_pairs.end(), 0);
}

int thimble_on(const World& w, int finger) {
    for (std::size_t t = 0; t < w.matchings.size(); ++t)
        if (finger >= 0 && w.matchings[t].finger == w.skins.owner(std::size_t(finger))) return int(t);
    return -1;
}

void carry_thimbles(Simulation& from, Simulation& to, const Rows& rows) {
    World &u = from.world, &v = to.world;
    for (std::size_t i = 0; i < v.skins.size(); ++i) {
        const int now = thimble_on(v, int(i)), before = thimble_on(u, rows.kept.fingers[i]);
        if (now < 0 || before < 0) continue;
        const Matching& a = u.matchings[std::size_t(before)];
        Matching& b = v.matchings[std::size_t(now)];
        if (!same_device(a.model, b.model) || a.force_mode != b.force_mode) continue;
        b.result = a.result, b.geometric = a.geometric, b.next = a.next, b.solves = a.solves;
        b.q = a.q, b.torque = a.torque, b.force_N = a.force_N;
        DeviceLink& link = v.device_links[std::size_t(now)];
        link.retreat = u.device_links[std::size_t(before)].retreat;
        link.retreats = u.device_links[std::size_t(before)].retreats;
        to.loops[std::size_t(now)] = std::move(from.loops[std::size_t(before)]);
        link.mailbox = &to.loops[std::size_t(now)]->mailbox;
    }
}

}  // namespace

void carry_kept(Simulation& from, Simulation& to, const KeptRows& kept) {
    World &u = from.world, &v = to.world;
    const Rows rows(kept, u, v);
    v.time = u.time, v.step = u.step, v.sampled_at = u.sampled_at, v.contact_growths = u.contact_growths;
    carry_objects(u, v, rows);  // first: contacts say whose bodies they are on
    carry_fingers(u, v, rows);
    carry_soft(u, v, rows);
    carry_thimbles(from, to, rows);
    for (std::size_t i = 0; i < kept.fingers.size(); ++i)
        if (kept.fingers[i] >= 0) to.finger_counts[i] = from.finger_counts[std::size_t(kept.fingers[i])];
    // New thimbles begin their clocks now.
    for (std::size_t t = 0; t < v.matchings.size(); ++t)
        if (v.matchings[t].solves == 0) v.matchings[t].next = v.time;
    to.live = from.live;
    to.pace = from.pace;
    if (to.governor && from.governor) to.governor = from.governor;
}

}  // namespace palpate
