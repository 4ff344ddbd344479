// Which fingers are near each other, and the plane between each two of them.

#include <algorithm>
#include <cmath>

#include "engine/bodies/islands.h"
#include "engine/systems.h"

namespace palpate {

namespace {

/// What finding pairs works on.
struct PairWork {
    const Table<Skin>& skins;
    const SolverSettings& solver;
    FingerPairs& pairs;
    SkinChunks& chunks;
};

template <class Visit>
auto with_finger(const PairWork& w, int finger, Visit visit) {
    const Skin& skin = w.skins[std::size_t(finger)];
    return w.chunks.with(skin.single_precision, skin.chunk, [&](auto& c) { return visit(c, skin.lane); });
}

/// How far a finger may go in this step in a direction [m]: with its bone's targets, by its springs' force, with its
/// own speed.
template <class T>
double travel_of(const SkinChunk<T>& c, int lane, const SolverSettings& solver, const Vec3<double>& direction) {
    const auto W = std::size_t(c.width);
    auto spring = [&](int s, int i) {
        return double(c.scratch.bone_springs[std::size_t(9 * s + i) * W + std::size_t(lane)]);
    };
    double travel[bone_spring_count];
    for (int s = 0; s < bone_spring_count; ++s) {
        Vec3<double> d;
        for (int k = 0; k < 3; ++k)
            d[k] = spring(s, 2 + k) - double(c.state.bone[std::size_t(k) * W + std::size_t(lane)]);
        travel[s] = std::max(0.0, dot(d, direction));
    }
    if (!solver.inertia) return travel[0];
    // What presses on something stretches the coupling; in one step it brings the bone no farther than its mass lets
    // it.
    const double pulled = travel[0] * std::min(1.0, spring(0, 0) / spring(2, 0));
    double speed = 0;
    if (!((c.rigid_lanes >> lane) & 1u))
        for (int node : c.topology->samples) {
            Vec3<double> v;
            for (int d = 0; d < 3; ++d) v[d] = c.state.velocity[std::size_t(3 * node + d) * W + std::size_t(lane)];
            speed = std::max(speed, dot(v, direction));
        }
    return std::max({pulled, travel[1], travel[2], solver.dt * speed});
}

/// The bone's origin, then the pad: where pads have crossed, bones tell which finger is on which side.
template <class T>
void read_pad(const SkinChunk<T>& c, int lane, std::vector<Vec3<double>>& pad) {
    pad.clear();
    pad.push_back(lane_bone(c, lane).position);
    for (int node : c.topology->samples) pad.push_back(node_position(c, node, lane));
}

/// What of two pads comes first to a plane between them: a's point that is farthest against `n`, b's farthest along it.
struct Support {
    Vec3<double> of_a, of_b;
    double gap;  ///< of the two along n; below 0: the pads overlap along it
};
Support support(const FingerPairs& pairs, const Vec3<double>& n) {
    Support s{pairs.pad_a[0], pairs.pad_b[0], 0};
    double low = dot(n, s.of_a), high = dot(n, s.of_b);
    for (const Vec3<double>& x : pairs.pad_a)
        if (const double d = dot(n, x); d < low) low = d, s.of_a = x;
    for (const Vec3<double>& x : pairs.pad_b)
        if (const double d = dot(n, x); d > high) high = d, s.of_b = x;
    s.gap = low - high;
    return s;
}

Vec3<double> unit_vector(const Vec3<double>& v) {
    const double length = norm(v);
    return length > 1e-12 ? (1 / length) * v : Vec3<double>{0, 0, 1};
}

/// The direction along which two pads are farthest apart: that of the nearest points of their convex hulls (Gilbert
/// 1966). Where they overlap, or almost touch, no more than a guess.
Vec3<double> widest_gap(const FingerPairs& pairs, const Vec3<double>& guess) {
    Support s = support(pairs, guess);
    Vec3<double> v = s.of_a - s.of_b;
    for (int k = 0; k < 40; ++k) {
        s = support(pairs, unit_vector(v));
        const Vec3<double> w = s.of_a - s.of_b, along = w - v;
        if (dot(v, v) - dot(v, w) <= 1e-3 * dot(v, v)) break;
        const double travel = -dot(v, along) / std::max(dot(along, along), 1e-30);
        v = v + std::clamp(travel, 0.0, 1.0) * along;
    }
    return unit_vector(v);
}

/// The direction, near a guess, along which pads that overlap do so least (ascent along subgradients).
Vec3<double> least_overlap(const FingerPairs& pairs, Vec3<double> n) {
    Vec3<double> best = n;
    double widest = support(pairs, n).gap;
    for (int k = 0; k < 20; ++k) {
        const Support s = support(pairs, n);
        const Vec3<double> apart = s.of_a - s.of_b, across = apart - dot(apart, n) * n;
        n = unit_vector(n + (0.3 / (1 + k)) * unit_vector(across));
        if (const double gap = support(pairs, n).gap; gap > widest) widest = gap, best = n;
    }
    return best;
}

/// A rotation whose z axis is n, the shortest from another.
Quaternion<double> turned_to(const Quaternion<double>& from, const Vec3<double>& n) {
    const Vec3<double> z = rotation_matrix(from).column(2);
    const double c = dot(z, n);
    if (c < -0.999999) {  // half a turn, about any axis across
        const Vec3<double> x = rotation_matrix(from).column(0);
        return normalised(Quaternion<double>{0, x.x, x.y, x.z} * from);
    }
    const Vec3<double> axis = cross(z, n);
    return normalised(normalised(Quaternion<double>{1 + c, axis.x, axis.y, axis.z}) * from);
}

/// How a finger's bone carries a point of it along.
struct Carried {
    Vec3<double> speed, spin;
};
template <class T>
Carried carried(const SkinChunk<T>& c, int lane, const Vec3<double>& point) {
    auto rate = [&](int i) { return double(c.state.bone_velocity[std::size_t(i * c.width + lane)]); };
    const Vec3<double> spin{rate(3), rate(4), rate(5)};
    return {Vec3<double>{rate(0), rate(1), rate(2)} + cross(spin, point - lane_bone(c, lane).position), spin};
}

/// Whether two pads so far apart along n may touch in this step.
bool may_touch(const PairWork& w, const FingerPair& p, const Vec3<double>& n, double gap) {
    if (gap <= 1e-3) return true;
    const double travel = with_finger(w, p.a, [&](auto& c, int lane) { return travel_of(c, lane, w.solver, -n); }) +
                          with_finger(w, p.b, [&](auto& c, int lane) { return travel_of(c, lane, w.solver, n); });
    return gap <= 1e-3 + 2 * travel;
}

/// Puts a plane between the two pads where they do not press on it; returns whether they may in this step.
bool place_between(const PairWork& w, FingerPair& p, const FingerPair* before) {
    const Vec3<double> apart = unit_vector(w.pairs.pad_a[0] - w.pairs.pad_b[0]);
    Vec3<double> n = before ? rotation_matrix(before->pose.rotation).column(2) : apart;
    const Quaternion<double> last = before ? before->pose.rotation : Quaternion<double>::identity();
    Support s = support(w.pairs, n);
    bool near = may_touch(w, p, n, s.gap);
    if (near) {  // along the last plane's normal: there may be a better one
        n = widest_gap(w.pairs, n);
        s = support(w.pairs, n);
        if (s.gap <= 0) {
            n = before ? rotation_matrix(last).column(2) : least_overlap(w.pairs, apart);
            s = support(w.pairs, n);
        }
        near = may_touch(w, p, n, s.gap);
    }
    p.start = {0.5 * (s.of_a + s.of_b), turned_to(last, n)};
    p.pose = p.start;
    return near;
}

/// Whether two fingers that may be near each other are; the plane between them.
bool is_near(PairWork& w, FingerPair& p, const FingerPair* before) {
    if (before && before->touching) {
        p.start = {before->centre, before->pose.rotation};
    } else {
        with_finger(w, p.a, [&](auto& c, int lane) { read_pad(c, lane, w.pairs.pad_a); });
        with_finger(w, p.b, [&](auto& c, int lane) { read_pad(c, lane, w.pairs.pad_b); });
        if (!place_between(w, p, before)) return false;
    }
    p.pose = p.start;
    p.touched = before && before->touching;
    if (!w.solver.inertia) return true;
    if (p.touched && before->touched) {  // it goes on as it went
        const Quaternion<double> turn = before->pose.rotation * conjugate(before->start.rotation);
        p.pose.position += before->pose.position - before->start.position +
                           rotation_matrix(turn) * (before->centre - before->pose.position) -
                           (before->centre - before->pose.position);
        p.pose.rotation = normalised(turn * p.start.rotation);
        if (w.pairs.friction <= 0) {  // nothing holds it along itself: it went metres away, further in every step
            const Vec3<double> n = rotation_matrix(p.pose.rotation).column(2);
            p.pose.position = p.start.position + dot(n, p.pose.position - p.start.position) * n;
        }
        return true;
    }
    const auto of_a = with_finger(w, p.a, [&](auto& c, int lane) { return carried(c, lane, p.start.position); });
    const auto of_b = with_finger(w, p.b, [&](auto& c, int lane) { return carried(c, lane, p.start.position); });
    const double half = 0.5 * w.solver.dt;
    p.pose.position += half * (of_a.speed + of_b.speed);
    p.pose.rotation = normalised(rotation_step(half * (of_a.spin + of_b.spin)) * p.start.rotation);
    return true;
}

bool is_still(const PairWork& w, int finger) {
    return with_finger(
        w, finger, [&](auto& c, int lane) { return ((c.unchanged_lanes >> lane) & 1u) != 0 && same_target(c, lane); });
}

/// Sweeps over the fingers from low to high x for those whose reaches meet.
void find_pairs(PairWork& w) {
    FingerPairs& pairs = w.pairs;
    for (std::size_t i = 0; i < pairs.reach.size(); ++i)
        pairs.reach[i] = with_finger(w, int(i), [&](auto& c, int lane) { return c.reach[std::size_t(lane)]; });
    auto low = [&](int i) { return pairs.reach[std::size_t(i)].centre.x - pairs.reach[std::size_t(i)].radius; };
    // Hardly anything changes from step to step: sorting by insertion costs no more than looking.
    for (std::size_t i = 1; i < pairs.order.size(); ++i)
        for (std::size_t k = i; k > 0 && low(pairs.order[k]) < low(pairs.order[k - 1]); --k)
            std::swap(pairs.order[k], pairs.order[k - 1]);
    auto find = [&](const FingerPair& p) {
        return std::find_if(pairs.before.begin(), pairs.before.end(),
                            [&](const FingerPair& q) { return q.a == p.a && q.b == p.b; });
    };
    for (const FingerPair& p : pairs.near)
        if (const auto same = find(p); same != pairs.before.end()) *same = p;
    pairs.near.clear();
    std::size_t known = 0;  // the first of `before` are those found in this step
    for (std::size_t i = 0; i < pairs.order.size(); ++i) {
        const Sphere& a = pairs.reach[std::size_t(pairs.order[i])];
        for (std::size_t k = i + 1; k < pairs.order.size(); ++k) {
            const Sphere& b = pairs.reach[std::size_t(pairs.order[k])];
            if (b.centre.x - b.radius > a.centre.x + a.radius) break;
            const Vec3<double> d = a.centre - b.centre;
            const double within = a.radius + b.radius;
            if (!(dot(d, d) < within * within)) continue;
            FingerPair p;
            p.a = std::min(pairs.order[i], pairs.order[k]);
            p.b = std::max(pairs.order[i], pairs.order[k]);
            auto same = find(p);
            const bool fresh = same == pairs.before.end();
            if (fresh) same = pairs.before.insert(pairs.before.end(), p);
            // Two that sleep were not near, and are where they were.
            const bool still = !fresh && is_still(w, p.a) && is_still(w, p.b);
            if (!still && is_near(w, p, fresh ? nullptr : &*same)) pairs.near.push_back(p);
            if (!still) *same = p;
            std::iter_swap(same, pairs.before.begin() + std::ptrdiff_t(known++));
        }
    }
    pairs.before.resize(known);
    std::sort(pairs.near.begin(), pairs.near.end(),
              [](const FingerPair& p, const FingerPair& q) { return p.a != q.a ? p.a < q.a : p.b < q.b; });
}

/// Gives every chunk what fingers that touch each other need: all of them, so that fingers can still change places.
bool reserve_planes(PairWork& w, int bodies, BodySolve& solve) {
    const int places = bodies + int(w.pairs.near.size());
    bool grew = false;
    if (places > solve.places) {
        reserve_islands(solve, std::max(places, solve.places * 3 / 2), w.chunks.count());
        grew = true;
    }
    std::size_t most = 0;
    w.chunks.for_each([&](auto& c) {
        most = std::max(most, c.topology->sample_count());
        if (c.has_bodies && (c.has_friction || w.pairs.friction <= 0)) return;
        grew |= c.exchange.columns.capacity() == 0;
        c.has_bodies = true;
        c.has_friction = c.has_friction || w.pairs.friction > 0;
        resize_fields(c);
    });
    w.pairs.samples.reserve(2 * most);
    return grew;
}

/// Puts the planes that a finger is near to into its lane's slots, after those of objects, in the order of the fingers
/// on their other sides; takes out those that it was near to.
int fill_slots(PairWork& w, int objects, int bodies) {
    FingerPairs& pairs = w.pairs;
    int growths = 0;
    for (std::size_t i = 0; i < pairs.slot.size(); ++i)
        pairs.slot[i] = with_finger(w, int(i), [&](auto& c, int lane) {
            int slot = c.contacts.count[std::size_t(lane)];
            while (slot > 0 && c.contacts.at(slot - 1, lane).finger >= 0) --slot;
            return slot;
        });
    // Pairs come in such an order that each finger meets its others in the order of their rows.
    for (std::size_t k = 0; k < pairs.near.size(); ++k)
        for (const bool of_b : {false, true}) {
            const FingerPair& p = pairs.near[k];
            const int finger = of_b ? p.b : p.a, other = of_b ? p.a : p.b;
            LaneContact contact;
            contact.object = objects + other;
            contact.shape.kind = ShapeKind::plane;
            contact.pose = plane_side(p.pose, of_b);
            contact.start = plane_side(p.start, of_b);
            contact.friction = pairs.friction;
            contact.body = bodies + int(k);
            contact.finger = other;
            with_finger(w, finger, [&](auto& c, int lane) {
                int& slot = pairs.slot[std::size_t(finger)];
                const int& count = c.contacts.count[std::size_t(lane)];
                while (slot < count && c.contacts.at(slot, lane).finger < other) erase_contact(c, lane, slot);
                if (slot < count && c.contacts.at(slot, lane).finger == other) {
                    c.contacts.at(slot, lane) = contact;
                } else {
                    contact.fresh = true;
                    growths += insert_contact(c, lane, slot, contact);
                }
                ++slot;
            });
        }
    for (std::size_t i = 0; i < pairs.slot.size(); ++i)
        with_finger(w, int(i), [&](auto& c, int lane) {
            while (c.contacts.count[std::size_t(lane)] > pairs.slot[i])
                erase_contact(c, lane, c.contacts.count[std::size_t(lane)] - 1);
        });
    return growths;
}

}  // namespace

int detect_finger_pairs(const Table<VirtualObject>& shapes, const Table<RigidBody>& bodies, const Table<Skin>& skins,
                        const SolverSettings& solver, BodySolve& solve, FingerPairs& pairs, SkinChunks& chunks) {
    if (!pairs.on) return 0;
    PairWork w{skins, solver, pairs, chunks};
    auto memory = [&] {
        return pairs.near.capacity() + pairs.before.capacity() + pairs.pad_a.capacity() + pairs.pad_b.capacity();
    };
    const bool were_near = !pairs.near.empty();
    const std::size_t had = memory();
    find_pairs(w);
    int growths = memory() > had;
    if (pairs.near.empty() && !were_near) return growths;
    if (!pairs.near.empty()) growths += reserve_planes(w, int(bodies.size()), solve);
    return growths + fill_slots(w, int(shapes.size()), int(bodies.size()));
}

}  // namespace palpate
