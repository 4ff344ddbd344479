#include "engine/bodies/islands.h"

#include <algorithm>
#include <cmath>

#include "engine/bodies/anchors.h"

namespace palpate {

namespace {

void find_coupled_chunks(BodyWork& w) {
    w.s.coupled.clear();
    int index = 0;
    w.chunks.for_each([&](const auto& c) {
        if (solved_with_others(c)) w.s.coupled.push_back(index);
        ++index;
    });
}

void set_object(BodyWork& w, int object) {
    const VirtualObject& shape = w.shapes[object];
    ContactBody& o = w.s.objects[object];
    o = {&shape.shape, shape.previous, shape.pose, shape.pose.position, shape.body, 0, false, {0, 0, 0}};
    if (shape.body < 0) {
        const Quaternion<double> turn = shape.pose.rotation * conjugate(shape.previous.rotation);
        o.speed = norm(shape.pose.position - shape.previous.position) / w.solver.dt;
        o.still = o.speed <= 0 && norm(turn.vector()) <= 1e-15;
        o.turn = shorter_twice_vector(turn);
        return;
    }
    const BodyProgress& b = w.s.bodies[shape.body];
    const RigidBody& body = w.bodies[shape.body];
    o.pose = object_pose(body, b.pose);
    o.centre = b.pose.position;
    o.still = body.asleep;
    if (o.still) return;
    const Vec3<double> spin = angular_velocity(body, o.pose.rotation);
    o.speed = norm(body.velocity) + norm(spin) * body.size;
    o.turn = w.solver.dt * spin;
}

bool may_touch(const BodyWork& w, int a, int b) {
    const ShapeKind kind_a = w.shapes[a].shape.kind, kind_b = w.shapes[b].shape.kind;
    if (a == b || (w.shapes[a].body < 0 && w.shapes[b].body < 0)) return false;
    if (w.shapes[a].soft >= 0 || w.shapes[b].soft >= 0) return false;  // its skin touches them
    // A ball's one feature is exact against anything; the other's points against it would count the contact twice.
    if (kind_b == ShapeKind::sphere && (kind_a != ShapeKind::sphere || a > b)) return false;
    const ContactBody &of_a = w.s.objects[a], &of_b = w.s.objects[b];
    const double travel = fitted::near_gap + 2 * w.solver.dt * (of_a.speed + of_b.speed) + farthest_fall(w.solver);
    if (norm(of_a.centre - of_b.centre) > w.s.reach[a] + w.s.reach[b] + travel) return false;
    // Either way: over a wide table much is within the table's reach, and not near it.
    return surface_point(*of_b.shape, of_b.pose, of_a.centre).distance < w.s.reach[a] + travel &&
           surface_point(*of_a.shape, of_a.pose, of_b.centre).distance < w.s.reach[b] + travel;
}

double pair_friction(const BodyWork& w, const std::vector<PairFriction>& given, int a, int b) {
    for (const PairFriction& p : given)
        if ((p.a == a && p.b == b) || (p.a == b && p.b == a)) return p.friction;
    return std::sqrt(w.shapes[a].friction * w.shapes[b].friction);
}

/// Velocity of a's point relative to b's, before the step [m/s].
Vec3<double> point_velocity(const BodyWork& w, const BodyPair& p, const Vec3<double>& point) {
    const ContactBody &a = w.s.objects[p.a], &b = w.s.objects[p.b];
    Vec3<double> v{0, 0, 0};
    for (auto [object, sign] : {std::pair{&a, 1.0}, std::pair{&b, -1.0}}) {
        if (object->body < 0) {
            v += (sign / w.solver.dt) * (transform(object->pose, inverse_transform(object->start, point)) - point);
            continue;
        }
        const RigidBody& body = w.bodies[object->body];
        const Vec3<double> turn = angular_velocity(body, object->start.rotation);
        v += sign * (body.velocity + cross(turn, point - w.s.bodies[object->body].start.position));
    }
    return v;
}

/// The objects that a may touch; places for all of them.
void find_near(BodyWork& w, int a) {
    BodySolve& s = w.s;
    s.near_objects.clear();
    auto has_pair = [&](int b) {
        return std::any_of(s.pairs.begin() + s.first_pair[a], s.pairs.begin() + s.first_pair[a + 1],
                           [&](const BodyPair& p) { return p.a >= 0 && p.b == b; });
    };
    for (int b = 0; b < int(w.shapes.size()); ++b)
        if (s.objects[a].still && s.objects[b].still ? has_pair(b) : may_touch(w, a, b)) s.near_objects.push_back(b);
    s.wanted_pairs[a] = int(s.near_objects.size());
    if (s.wanted_pairs[a] > s.first_pair[a + 1] - s.first_pair[a]) grow_pairs(s, 0);
}

/// A pair at the start of a step in which it is near; `fresh`: for the first time.
void begin_near_pair(BodyWork& w, BodyPair& p, bool fresh, const std::vector<PairFriction>& given) {
    p.friction = pair_friction(w, given, p.a, p.b);
    double mass = 1e300;
    for (int object : {p.a, p.b})
        if (w.shapes[object].body >= 0) mass = std::min(mass, w.bodies[w.shapes[object].body].mass);
    const double time = w.solver.inertia ? w.solver.dt : fitted::anchor_time;
    p.penalty =
        std::max({fitted::least_pair_penalty, fitted::pair_inertia_share * mass / (time * time), load_penalty(p)});
    const ContactBody &a = w.s.objects[p.a], &b = w.s.objects[p.b];
    const std::vector<Feature>& features = features_of_pair(w.s, p);
    begin_pair(p, features, a, b);
    auto without_contact = [&](const ContactBody& o) {
        return o.body < 0 ? o.pose : object_pose(w.bodies[o.body], w.s.bodies[o.body].target);
    };
    stop_falls(p, features, a, b, without_contact(a), without_contact(b));
    auto for_each_contact = [&](auto visit) {
        for (std::size_t i = 0; i < features.size(); ++i)
            visit(p.contacts[i], touch_of(features[i], a.start, p.contacts[i], *b.shape, b.start, 0));
    };
    const double recovery = w.solver.dt * w.solver.recovery_speed;
    const double overlap_begins =
        fresh ? std::min(fitted::overlap_of_fresh, fitted::overlap_of_fresh_share * recovery) : fitted::overlap_begins;
    auto begin_contact = [&](FeatureContact& c, const Touch& at) {
        c.approach = -dot(point_velocity(w, p, at.point), at.surface.normal);
        c.sunk = std::max(0.0, -at.surface.distance);
        if (w.solver.inertia) undo_overlap(c, -at.surface.distance, overlap_begins, recovery);
    };
    for_each_contact(begin_contact);
    if (find_exit_face(p, features, a, b)) for_each_contact(begin_contact);
    if (std::none_of(p.contacts.begin(), p.contacts.end(), [](const FeatureContact& c) { return c.undone > 0; }))
        return;
    for_each_contact([&](const FeatureContact& c, const Touch& at) {
        const double depth = -at.surface.distance;
        if (c.undone > 0 && depth > std::max(w.s.deepest.depth, fitted::overlap_begins))
            w.s.deepest = {p.a, p.b, depth, w.time};
    });
}

/// Finds the pairs of objects that may touch; a pair keeps its place, and with it its multipliers, while it is near.
void find_pairs(BodyWork& w, const std::vector<PairFriction>& given) {
    for (int a = 0; a < int(w.shapes.size()); ++a) {
        if (w.s.features[a].empty()) continue;
        find_near(w, a);
        BodyPair *first = w.s.pairs.data() + w.s.first_pair[a], *last = w.s.pairs.data() + w.s.first_pair[a + 1];
        auto place_of = [&](int b) {
            return std::find_if(first, last, [&](const BodyPair& p) { return p.a >= 0 && p.b == b; });
        };
        for (BodyPair* p = first; p != last; ++p) p->near = false;
        for (int b : w.s.near_objects)
            if (BodyPair* p = place_of(b); p != last) p->near = true;
        for (BodyPair* p = first; p != last; ++p)
            if (!p->near) p->a = p->b = -1;
        for (int b : w.s.near_objects) {
            BodyPair* p = place_of(b);
            const bool fresh = p == last;
            if (fresh) p = std::find_if(first, last, [](const BodyPair& q) { return q.a < 0; });
            p->a = a, p->b = b, p->near = true;
            const std::size_t features = features_of_pair(w.s, *p).size();
            if (fresh || p->contacts.size() != features)
                p->contacts.assign(features, FeatureContact{});  // within what it reserved
            if (!w.s.objects[a].still || !w.s.objects[b].still) begin_near_pair(w, *p, fresh, given);
        }
    }
}

/// Puts an object's body back to where the step began. Whether it had gone anywhere.
bool put_back(BodyWork& w, int object) {
    const int body = w.shapes[object].body;
    if (body < 0) return false;
    BodyProgress& b = w.s.bodies[body];
    if (norm(b.pose.position - b.start.position) <= 0) return false;
    b.pose = b.base = b.start;
    return true;
}

/// Bodies that would be deep in each other begin to be solved for where they were: from far inside, Newton may find
/// another way out, as a cube that falls flat on a plate in one long step and is turned over. So do those that would be
/// deep in one that has been put back: of a stack, all.
void begin_outside(BodyWork& w) {
    // How far the guess had led what has been put back.
    auto distance_back = [&](int object) {
        const int body = w.shapes[object].body;
        return body < 0 ? 0 : norm(w.s.objects[object].centre - w.s.bodies[body].pose.position);
    };
    for (bool again = true; again;) {
        again = false;
        for (const BodyPair& p : w.s.pairs) {
            if (p.a < 0) continue;
            const double lost = std::max(distance_back(p.a), distance_back(p.b));
            if (std::none_of(p.contacts.begin(), p.contacts.end(), [&](const FeatureContact& c) {
                    return c.distance - c.offset - lost < -fitted::deepest_guess;
                }))
                continue;
            again |= put_back(w, p.a);
            again |= put_back(w, p.b);
        }
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
            for (int lane = 0; lane < c.width; ++lane)
                for (int slot = 0; slot < c.contacts.count[std::size_t(lane)]; ++slot) {
                    const LaneContact& near = c.contacts.at(slot, lane);
                    if (near.body >= 0 && near.finger < 0 && w.bodies[near.body].asleep) rouse(near.object);
                }
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

/// Fingers share the island of the soft object that they are near.
void unite_soft_pairs(BodyWork& w) {
    auto place = [&](const Skin& skin) {
        const int chunk = skin.single_precision ? int(w.chunks.doubles.size()) + skin.chunk : skin.chunk;
        const auto at = std::find(w.s.coupled.begin(), w.s.coupled.end(), chunk);
        return int(w.s.bodies.size()) + 16 * int(at - w.s.coupled.begin()) + skin.lane;
    };
    for (const SoftPair& p : w.soft.pairs)
        if (p.near)
            unite(w.s.parent, place(w.skins[std::size_t(p.finger)]), place(w.soft.all[std::size_t(p.soft)].skin));
}

/// Groups lanes and bodies that may touch. Sleeping bodies share an island in which nothing is done.
void group(BodyWork& w) {
    BodySolve& s = w.s;
    const int bodies = int(s.bodies.size());
    const int count = bodies + 16 * int(s.coupled.size());
    for (int i = 0; i < count; ++i) s.parent[i] = i;
    for (const BodyPair& p : s.pairs)
        if (p.a >= 0 && !w.s.objects[p.a].still && w.shapes[p.a].body >= 0 && w.shapes[p.b].body >= 0)
            unite(s.parent, w.shapes[p.a].body, w.shapes[p.b].body);
    for (int k = 0; k < int(s.coupled.size()); ++k)
        with_chunk(w, k, [&](auto& c, const auto&) {
            for (int lane = 0; lane < c.width; ++lane)
                for (int slot = 0; slot < c.contacts.count[std::size_t(lane)]; ++slot)
                    if (const int body = c.contacts.at(slot, lane).body; body >= 0 && ((active_lanes(c) >> lane) & 1u))
                        unite(s.parent, body, bodies + 16 * k + lane);
        });
    unite_soft_pairs(w);
    s.island_count = 0;
    auto island = [&](int i) {
        const int r = root(s.parent, i);
        // A root's own number is smaller than its members': it is met first.
        if (r == i) {
            Island& fresh = s.islands[s.island_count];
            fresh.bodies.clear();
            fresh.progress = detail::begin_progress<double>(true);
            fresh.vain_updates = 0;
            return s.island_count++;
        }
        return r < bodies ? s.bodies[r].island : s.lane_island[r - bodies];
    };
    Island& sleepers = s.islands.back();
    sleepers.progress = detail::begin_progress<double>(false);
    sleepers.progress.converged = true;
    sleepers.decision = {};
    for (int b = 0; b < bodies; ++b) {
        if (!is_plane(w, b) && w.bodies[b].asleep) {
            s.bodies[b].island = int(s.islands.size()) - 1;
            continue;
        }
        s.bodies[b].island = island(b);
        s.bodies[b].row = 6 * int(s.islands[s.bodies[b].island].bodies.size());
        s.islands[s.bodies[b].island].bodies.push_back(b);
    }
    std::fill(s.lane_island.begin(), s.lane_island.end(), -1);
    s.fingers.clear();
    for (int k = 0; k < int(s.coupled.size()); ++k)
        with_chunk(w, k, [&](auto& c, const auto&) {
            for (int lane = 0; lane < c.width; ++lane) {
                if (!((active_lanes(c) >> lane) & 1u)) continue;
                s.lane_island[16 * k + lane] = island(bodies + 16 * k + lane);
                s.fingers.emplace_back(c.finger[std::size_t(lane)], 16 * k + lane);
            }
        });
    std::sort(s.fingers.begin(), s.fingers.end());
}

}  // namespace

Island& island_of_pair(BodyWork& w, const BodyPair& p) {
    const int body = w.shapes[p.a].body >= 0 ? w.shapes[p.a].body : w.shapes[p.b].body;
    return w.s.islands[w.s.bodies[body].island];
}

void grow_pairs(BodySolve& s, int at_least) {
    std::vector<BodyPair> grown;
    std::vector<int> first{0};
    for (std::size_t a = 0; a + 1 < s.first_pair.size(); ++a) {
        const int had = s.first_pair[a + 1] - s.first_pair[a];
        for (int k = s.first_pair[a]; k < s.first_pair[a + 1]; ++k) grown.push_back(std::move(s.pairs[k]));
        // Half as many again, so that growing is rare.
        const int wanted = std::max(at_least, s.wanted_pairs[a] > had ? s.wanted_pairs[a] * 3 / 2 : had);
        const int places = s.features[a].empty() ? 0 : std::min(wanted, int(s.features.size()) - 1);
        for (int k = had; k < places; ++k)
            grown.emplace_back().contacts.reserve(std::max(s.features[a].size(), s.plane_features[a].size()));
        first.push_back(int(grown.size()));
    }
    s.pairs = std::move(grown);
    s.first_pair = std::move(first);
}

void reserve_islands(BodySolve& s, int places, int chunks) {
    if (places <= s.places) return;
    s.places = places;
    const auto n = std::size_t(places) + 16 * std::size_t(chunks);
    s.bodies.reserve(std::size_t(places));
    s.parent.resize(n);
    s.lane_island.resize(16 * std::size_t(chunks));
    s.fingers.reserve(16 * std::size_t(chunks));
    s.coupled.reserve(std::size_t(chunks));
    s.islands.resize(n + 1);
    for (Island& i : s.islands) i.bodies.reserve(std::size_t(places));
    s.matrix.setZero(6 * places, 6 * places);
    s.rhs.setZero(6 * places);
}

namespace {

/// Planes have neither mass nor speed of their own: where they begin is a guess.
void begin_planes(BodyWork& w) {
    for (std::size_t k = 0; k < w.pairs.near.size(); ++k) {
        const FingerPair& p = w.pairs.near[k];
        BodyProgress& b = w.s.bodies[w.bodies.size() + k] = {};
        b.start = p.start;
        b.target = b.base = b.pose = p.pose;
    }
}

}  // namespace

namespace {

/// Bodies that are near nothing fly along their parabolas, whatever the step: implicit Euler, which contact needs,
/// takes half of the speed gained in a step away from a fall, and as much from what rises again.
void find_flying(BodyWork& w) {
    if (!w.solver.inertia) return;
    for (std::size_t row = 0; row < w.bodies.size(); ++row) w.s.bodies[row].flies = !w.bodies[row].asleep;
    for (const BodyPair& p : w.s.pairs)
        if (p.a >= 0)
            for (int object : {p.a, p.b})
                if (const int body = w.shapes[object].body; body >= 0) w.s.bodies[body].flies = false;
    for_each_lane(w, [&](const auto& c, int lane, const Island&) {
        for_each_body_of(w, c, lane, [](int, BodyProgress& b) { b.flies = false; });
    });
    const double dt = w.solver.dt;
    for (std::size_t row = 0; row < w.bodies.size(); ++row)
        if (BodyProgress& b = w.s.bodies[row]; b.flies)
            b.target.position -= (0.5 * dt * dt / w.bodies[row].mass) * b.weight;
}

}  // namespace

void find_islands(BodyWork& w, const Vec3<double>& gravity, const std::vector<PairFriction>& pair_frictions) {
    for (std::size_t object = 0; object < w.shapes.size(); ++object) {
        const VirtualObject& shape = w.shapes[object];
        if (shape.body < 0) continue;
        RigidBody& body = w.bodies[shape.body];
        BodyProgress& b = w.s.bodies[shape.body];
        const Pose<double> start = centre_pose(body, shape.previous);
        // Moved from outside: it has to look where it is.
        if (body.asleep && norm(start.position - b.pose.position) > 1e-9) body.asleep = false, body.still_steps = 0;
        b.start = start;
        b.weight = body.mass * gravity;
        if (w.solver.inertia)
            b.target = free_flight(body, b.start, gravity, w.solver.dt);
        else
            cast_anchor(w, body, b);
        b.base = b.pose = centre_pose(body, shape.pose);
        b.step.setZero();
        b.flies = false;
        b.kinetic = kinetic_energy(body, start.rotation);
    }
    begin_planes(w);
    find_coupled_chunks(w);
    if (!w.bodies.empty()) {
        for (std::size_t object = 0; object < w.shapes.size(); ++object) set_object(w, int(object));
        find_pairs(w, pair_frictions);
        begin_outside(w);
    }
    wake(w);
    group(w);
    find_flying(w);
}

}  // namespace palpate
