#include "engine/bodies/islands.h"

#include <algorithm>
#include <cmath>

namespace palpate {

namespace {

template <class T>
bool near_a_body(const SkinChunk<T>& c) {
    return std::any_of(c.slots.begin(), c.slots.end(), [](auto& s) { return s.object >= 0 && s.body >= 0; });
}

void find_coupled_chunks(BodyWork& w) {
    w.s.coupled.clear();
    const int doubles = int(w.double_chunks.size());
    for (int i = 0; i < doubles; ++i)
        if (near_a_body(w.double_chunks[i])) w.s.coupled.push_back(i);
    for (int i = 0; i < int(w.float_chunks.size()); ++i)
        if (near_a_body(w.float_chunks[i])) w.s.coupled.push_back(doubles + i);
}

void set_object(BodyWork& w, int object) {
    const RigidShape& shape = w.shapes[object];
    ContactBody& o = w.s.objects[object];
    o = {&shape.shape, shape.previous, shape.pose, shape.pose.position, shape.body, 0, false};
    if (shape.body < 0) {
        const Quaternion<double> turn = shape.pose.rotation * conjugate(shape.previous.rotation);
        o.speed = norm(shape.pose.position - shape.previous.position) / w.solver.dt;
        o.still = o.speed <= 0 && norm(turn.vector()) <= 1e-15;
        return;
    }
    const BodyProgress& b = w.s.bodies[shape.body];
    const RigidBody& body = w.bodies[shape.body];
    o.pose = object_pose(body, b.pose);
    o.centre = b.pose.position;
    o.still = body.asleep;
    if (!o.still) o.speed = norm(body.velocity) + norm(angular_velocity(body, o.pose.rotation)) * body.size;
}

bool may_touch(const BodyWork& w, int a, int b) {
    const ShapeKind kind_a = w.shapes[a].shape.kind, kind_b = w.shapes[b].shape.kind;
    if (a == b || (w.shapes[a].body < 0 && w.shapes[b].body < 0)) return false;
    // A ball's one feature is exact against anything; the other's points against it would count the contact twice.
    if (kind_b == ShapeKind::sphere && (kind_a != ShapeKind::sphere || a > b)) return false;
    const ContactBody &of_a = w.s.objects[a], &of_b = w.s.objects[b];
    const double way = 1e-3 + 2 * w.solver.dt * (of_a.speed + of_b.speed) + 20 * w.solver.dt * w.solver.dt;
    if (norm(of_a.centre - of_b.centre) > w.s.reach[a] + w.s.reach[b] + way) return false;
    return surface_point(*of_b.shape, of_b.pose, of_a.centre).distance < w.s.reach[a] + way;
}

double pair_friction(const BodyWork& w, const std::vector<PairFriction>& given, int a, int b) {
    for (const PairFriction& p : given)
        if ((p.a == a && p.b == b) || (p.a == b && p.b == a)) return p.friction;
    return std::sqrt(w.shapes[a].friction * w.shapes[b].friction);
}

/// Speed at which the point that touches first approaches, before the step.
double approach_speed(const BodyWork& w, const BodyPair& p, const FeatureContact& c) {
    const ContactBody &a = w.s.objects[p.a], &b = w.s.objects[p.b];
    const Vec3<double> point = transform(a.start, c.point_of_a);
    Vec3<double> v{0, 0, 0};
    for (auto [object, sign] : {std::pair{&a, 1.0}, std::pair{&b, -1.0}}) {
        if (object->body < 0) {
            v += (sign / w.solver.dt) * (object->pose.position - object->start.position);
            continue;
        }
        const RigidBody& body = w.bodies[object->body];
        const Vec3<double> turn = angular_velocity(body, object->start.rotation);
        v += sign * (body.velocity + cross(turn, point - w.s.bodies[object->body].start.position));
    }
    return -dot(v, surface_point(*b.shape, b.start, point).normal);
}

/// Finds the pairs of objects that may touch; a pair keeps its place, and with it its multipliers, while it is near.
void find_pairs(BodyWork& w, const std::vector<PairFriction>& given) {
    for (int a = 0; a < int(w.shapes.size()); ++a) {
        BodyPair* first = w.s.pairs.data() + std::size_t(a) * w.s.partners;
        BodyPair* last = first + w.s.partners;
        for (BodyPair* p = first; p != last; ++p) p->near = false;
        if (w.s.features[a].empty()) continue;
        for (int b = 0; b < int(w.shapes.size()); ++b) {
            auto holds_b = [&](const BodyPair& q) { return q.a >= 0 && q.b == b; };
            if (w.s.objects[a].still && w.s.objects[b].still) {  // as it was
                if (BodyPair* p = std::find_if(first, last, holds_b); p != last) p->near = true;
                continue;
            }
            if (!may_touch(w, a, b)) continue;
            BodyPair* p = std::find_if(first, last, holds_b);
            if (p == last) {
                p = std::find_if(first, last, [](const BodyPair& q) { return q.a < 0; });
                if (p == last) continue;
                std::fill(p->contacts.begin(), p->contacts.end(), FeatureContact{});
            }
            p->a = a, p->b = b, p->near = true;
            p->friction = pair_friction(w, given, a, b);
            double mass = 1e300;
            for (int object : {a, b})
                if (w.shapes[object].body >= 0) mass = std::min(mass, w.bodies[w.shapes[object].body].mass);
            p->penalty = std::max({2e5, 30 * mass / (w.solver.dt * w.solver.dt), load_penalty(*p)});
            begin_pair(*p, w.s.features[a], w.s.objects[a], w.s.objects[b]);
            for (FeatureContact& c : p->contacts) c.approach = approach_speed(w, *p, c);
        }
        for (BodyPair* p = first; p != last; ++p)
            if (!p->near) p->a = p->b = -1;
    }
}

int root(std::vector<int>& parent, int i) {
    while (parent[i] != i) i = parent[i] = parent[parent[i]];
    return i;
}

void unite(std::vector<int>& parent, int a, int b) {
    a = root(parent, a), b = root(parent, b);
    parent[std::max(a, b)] = std::min(a, b);
}

/// Wakes bodies that something has come near to, and those that touch them.
void wake(BodyWork& w) {
    auto rouse = [&](int object) {
        RigidBody& body = w.bodies[w.shapes[object].body];
        body.asleep = false;
        body.still_steps = 0;
        w.s.objects[object].still = false;
    };
    for (int k = 0; k < int(w.s.coupled.size()); ++k)
        with_chunk(w, k, [&](auto& c, const auto&) {
            for (const ContactSlot& slot : c.slots)
                if (slot.object >= 0 && slot.body >= 0 && w.bodies[slot.body].asleep) rouse(slot.object);
        });
    for (bool again = true; again;) {
        again = false;
        for (const BodyPair& p : w.s.pairs) {
            if (p.a < 0 || w.s.objects[p.a].still == w.s.objects[p.b].still) continue;
            const int still = w.s.objects[p.a].still ? p.a : p.b;
            if (w.shapes[still].body < 0) continue;
            rouse(still);
            again = true;
        }
    }
}

/// Groups lanes and bodies that may touch. Sleeping bodies share an island in which nothing is done.
void group(BodyWork& w) {
    BodySolve& s = w.s;
    const int bodies = int(w.bodies.size());
    const int count = bodies + 16 * int(s.coupled.size());
    for (int i = 0; i < count; ++i) s.parent[i] = i;
    for (const BodyPair& p : s.pairs)
        if (p.a >= 0 && !w.s.objects[p.a].still && w.shapes[p.a].body >= 0 && w.shapes[p.b].body >= 0)
            unite(s.parent, w.shapes[p.a].body, w.shapes[p.b].body);
    for (int k = 0; k < int(s.coupled.size()); ++k)
        with_chunk(w, k, [&](auto& c, const auto&) {
            for (int lane = 0; lane < c.width; ++lane)
                for (int slot = 0; slot < c.slot_capacity; ++slot)
                    if (c.slots[slot].object >= 0 && c.slots[slot].body >= 0 &&
                        ((c.slots[slot].near_lanes >> lane) & (active_lanes(c) >> lane) & 1u))
                        unite(s.parent, c.slots[slot].body, bodies + 16 * k + lane);
        });
    s.island_count = 0;
    auto island = [&](int i) {
        const int r = root(s.parent, i);
        // A root's own number is smaller than its members': it is met first.
        if (r == i) {
            Island& fresh = s.islands[s.island_count];
            fresh.bodies.clear();
            fresh.progress = {};
            fresh.progress.active = true;
            fresh.progress.converged = fresh.progress.failed = false;
            fresh.progress.base_energy = fresh.progress.last_excess = fresh.progress.last_depth =
                std::numeric_limits<double>::max();
            fresh.progress.slope = fresh.progress.alpha = fresh.progress.damping = fresh.progress.exactness = 0;
            return s.island_count++;
        }
        return r < bodies ? s.bodies[r].island : s.lane_island[r - bodies];
    };
    Island& sleepers = s.islands.back();
    sleepers.progress = {};
    sleepers.progress.active = sleepers.progress.failed = false;
    sleepers.progress.converged = true;
    sleepers.decision = {};
    for (int b = 0; b < bodies; ++b) {
        if (w.bodies[b].asleep) {
            s.bodies[b].island = int(s.islands.size()) - 1;
            continue;
        }
        s.bodies[b].island = island(b);
        s.bodies[b].row = 6 * int(s.islands[s.bodies[b].island].bodies.size());
        s.islands[s.bodies[b].island].bodies.push_back(b);
    }
    std::fill(s.lane_island.begin(), s.lane_island.end(), -1);
    for (int k = 0; k < int(s.coupled.size()); ++k)
        with_chunk(w, k, [&](auto& c, const auto&) {
            for (int lane = 0; lane < c.width; ++lane)
                if ((active_lanes(c) >> lane) & 1u) s.lane_island[16 * k + lane] = island(bodies + 16 * k + lane);
        });
}

}  // namespace

Island& island_of_pair(BodyWork& w, const BodyPair& p) {
    const int body = w.shapes[p.a].body >= 0 ? w.shapes[p.a].body : w.shapes[p.b].body;
    return w.s.islands[w.s.bodies[body].island];
}

void find_islands(BodyWork& w, const Vec3<double>& gravity, const std::vector<PairFriction>& pair_frictions) {
    for (std::size_t object = 0; object < w.shapes.size(); ++object) {
        const RigidShape& shape = w.shapes[object];
        if (shape.body < 0) continue;
        RigidBody& body = w.bodies[shape.body];
        if (!w.solver.inertia) body.velocity = body.angular_momentum = {0, 0, 0};
        BodyProgress& b = w.s.bodies[shape.body];
        const Pose<double> start = centre_pose(body, shape.previous);
        // Moved from outside: it has to look where it is.
        if (body.asleep && norm(start.position - b.pose.position) > 1e-9) body.asleep = false, body.still_steps = 0;
        b.start = start;
        b.target = free_flight(body, b.start, gravity, w.solver.dt);
        b.base = b.pose = centre_pose(body, shape.pose);
        b.step.setZero();
    }
    for (std::size_t object = 0; object < w.shapes.size(); ++object) set_object(w, int(object));
    find_coupled_chunks(w);
    find_pairs(w, pair_frictions);
    wake(w);
    group(w);
}

}  // namespace palpate
