#include "engine/skin/chunks/contact_slots.h"

#include <algorithm>

#include "engine/contact/sides.h"
#include "engine/skin/chunks/fields.h"
#include "engine/skin/solver_settings.h"

namespace palpate {

namespace {

/// Calls visit(numbers, count, stride) for what a finger keeps of one slot of a lane: number i is numbers[i * width].
template <class T, class Visit>
void for_each_kept(SkinChunk<T>& c, int lane, int slot, Visit visit) {
    for_each_field(c, [&](auto& array, const Field& f) {
        if (f.owner != Owner::slot || !stays_with_finger(f) || f.size == 0) return;
        visit(array.data() + std::size_t(slot) * f.size * std::size_t(c.width) + lane, f.size);
    });
}

/// What a slot of a lane holds goes to another slot of it.
template <class T>
void shift_contact(SkinChunk<T>& c, int lane, int from, int to) {
    const std::ptrdiff_t slots = to - from, W = c.width;
    for_each_kept(c, lane, from, [&](auto* numbers, std::size_t count) {
        const std::ptrdiff_t away = slots * std::ptrdiff_t(count) * W;
        for (std::size_t i = 0; i < count; ++i, numbers += W) numbers[away] = *numbers;
    });
    c.contacts.at(to, lane) = c.contacts.at(from, lane);
}

template <class T>
void clear_contact(SkinChunk<T>& c, int lane, int slot) {
    for_each_kept(c, lane, slot, [&](auto* numbers, std::size_t count) {
        for (std::size_t i = 0; i < count; ++i, numbers += c.width) *numbers = 0;
    });
    c.contacts.at(slot, lane) = {};
}

template <class T>
bool reserve_contacts(SkinChunk<T>& c, int count) {
    ContactSlots& s = c.contacts;
    if (count <= s.capacity) return false;
    const std::size_t room = s.lane_contact.capacity();
    s.capacity = std::max(count, s.capacity + std::max(2, s.capacity / 2));
    resize_fields(c);
    return s.lane_contact.capacity() > room;
}

}  // namespace

template <class T>
bool insert_contact(SkinChunk<T>& c, int lane, int slot, const LaneContact& contact) {
    ContactSlots& s = c.contacts;
    int& count = s.count[std::size_t(lane)];
    const bool grew = reserve_contacts(c, count + 1);
    for (int k = count; k > slot; --k) shift_contact(c, lane, k - 1, k);
    clear_contact(c, lane, slot);
    s.at(slot, lane) = contact;
    ++count;
    return grew;
}

template <class T>
void erase_contact(SkinChunk<T>& c, int lane, int slot) {
    int& count = c.contacts.count[std::size_t(lane)];
    for (int k = slot; k + 1 < count; ++k) shift_contact(c, lane, k + 1, k);
    clear_contact(c, lane, --count);
}

template <class T>
void move_contacts(SkinChunk<T>& a, int lane_a, SkinChunk<T>& b, int lane_b) {
    int &from = a.contacts.count[std::size_t(lane_a)], &to = b.contacts.count[std::size_t(lane_b)];
    reserve_contacts(b, from);
    for_each_field_of_both(a, b, [&](auto& of_a, auto& of_b, const Field& f) {
        if (f.owner != Owner::slot || !stays_with_finger(f)) return;
        for (std::size_t i = 0; i < std::size_t(from) * f.size; ++i)
            of_b[i * std::size_t(b.width) + std::size_t(lane_b)] = of_a[i * std::size_t(a.width) + std::size_t(lane_a)];
    });
    for (int slot = 0; slot < from; ++slot) {
        b.contacts.at(slot, lane_b) = a.contacts.at(slot, lane_a);
        clear_contact(a, lane_a, slot);
    }
    to = from;
    from = 0;
}

namespace {

template <class T>
Vec3<double> origin_of_lane(const SkinChunk<T>& c, int lane) {
    const double* o = &c.state.origin[std::size_t(lane)];
    return {o[0], o[c.width], o[2 * c.width]};
}

/// A sample of a lane at the start of the step, from the lane's origin.
template <class T>
Vec3<double> start_of_sample(const SkinChunk<T>& c, std::size_t s, int lane) {
    const SkinTopology& t = *c.topology;
    auto node = [&](int i) {
        const T* p = &c.scratch.start_position[std::size_t(3 * i * c.width + lane)];
        return Vec3<double>{double(p[0]), double(p[c.width]), double(p[2 * c.width])};
    };
    if (s < t.samples.size()) return node(t.samples[s]);
    const FaceSample& f = t.face_samples[s - t.samples.size()];
    return double(f.weight[0]) * node(f.node[0]) + double(f.weight[1]) * node(f.node[1]) +
           double(f.weight[2]) * node(f.node[2]);
}

/// Outward normal of the skin around a sample at the start of the step.
template <class T>
Vec3<double> skin_normal_of_sample(const SkinChunk<T>& c, std::size_t s, int lane) {
    const SkinTopology& t = *c.topology;
    auto at = [&](std::size_t i) {
        const T* n = &c.scratch.skin_normal[3 * i * std::size_t(c.width) + std::size_t(lane)];
        return Vec3<double>{double(n[0]), double(n[c.width]), double(n[2 * c.width])};
    };
    if (s < t.samples.size()) return at(s);
    const FaceSample& f = t.face_samples[s - t.samples.size()];
    Vec3<double> n{0, 0, 0};
    for (std::size_t k = 0; k < 3; ++k) n += f.weight[k] * at(std::size_t(f.sample[k]));
    return (1 / std::max(norm(n), 1e-300)) * n;
}

/// A node of a sample.
int node_of_sample(const SkinTopology& t, std::size_t s) {
    return s < t.samples.size() ? t.samples[s] : int(t.face_samples[s - t.samples.size()].node[0]);
}

/// How much nearer a curved skin is to an object at a node than flat faces are [m]: the part of the bulge along the
/// object's normal at the start of the step, so that the step's potential stays a function of distances, and what acts
/// on the node and on the object is equal, torques included.
template <class T>
double set_rise(SkinChunk<T>& c, int slot, int lane, std::size_t sample, const Vec3<double>& normal) {
    const auto W = std::size_t(c.width);
    const T* bulge = &c.scratch.bulge[3 * sample * W + std::size_t(lane)];
    const double out = -dot(Vec3<double>{double(bulge[0]), double(bulge[W]), double(bulge[2 * W])}, normal);
    const T rise = T(std::max(0.0, out));  // a dent leaves nodes outside
    c.scratch.rise[(std::size_t(slot) * c.topology->samples.size() + sample) * W + std::size_t(lane)] = rise;
    return double(rise);
}

/// The side of an object that a sample of a lane is on in this step; `local`: the sample in the object's frame;
/// `wraps`: whether skin wraps its edges.
template <class T>
int side_of_sample(const SkinChunk<T>& c, int slot, int lane, std::size_t sample, const Vec3<double>& local, int before,
                   double travel, bool wraps) {
    const LaneContact& o = c.contacts.at(slot, lane);
    const Vec3<double> outward =
        transposed_times(rotation_matrix(o.start.rotation), skin_normal_of_sample(c, sample, lane));
    auto is_in_another = [&](const Vec3<double>& point, double deeper) {
        const Vec3<double> p = transform(o.start, point);
        for (int k = 0; k < c.contacts.count[std::size_t(lane)]; ++k) {
            const LaneContact& other = c.contacts.at(k, lane);
            if (k != slot && other.finger < 0 && surface_point(other.shape, other.start, p).distance < -deeper)
                return true;
        }
        return false;
    };
    const Vec3<double> origin = origin_of_lane(c, lane);
    const auto any_sample = [&](auto is) {
        for (std::size_t s = 0; s < c.topology->sample_count(); ++s)
            if (is(inverse_transform(o.start, origin + start_of_sample(c, s, lane)))) return true;
        return false;
    };
    if (const int round = wraps ? side_round_edge(o.shape, local, outward, plain_side(before), travel, any_sample) : 0)
        return round;
    int side = side_of_surface(o.shape, local, outward, before, travel);
    if (side != plain_side(side))
        return bridge_side(o.shape, local, side, travel, [&](const Vec3<double>& p) { return is_in_another(p, 0); });
    if (side == 0) side = side_of_thick(o.shape, local, plain_side(before));
    side = cover_side(o.shape, local, outward, side, travel,
                      [&](const Vec3<double>& p) { return is_in_another(p, fitted::level / 2); });
    return wraps ? wall_side(o.shape, local, side) : side;
}

/// The number of a sample's side to a mesh: 1 where it is through a wall (nodes_through_walls), and covered_mesh more
/// at the foot of a mesh that stands on something, and how its wall leans. `x`: the sample, world.
template <class T>
double side_of_mesh(SkinChunk<T>& c, int slot, int lane, const Vec3<double>& x, int before, double travel) {
    LaneContact& o = c.contacts.at(slot, lane);
    const Vec3<double> local = inverse_transform(o.start, x);
    const int through = before % covered_mesh;
    for (int k = 0; k < c.contacts.count[std::size_t(lane)]; ++k) {
        const LaneContact& other = c.contacts.at(k, lane);
        if (k == slot || other.finger >= 0 || other.stiffness > 0) continue;
        const SurfacePoint<double> ground = surface_point(other.shape, other.start, x);
        const Vec3<double> up = transposed_times(rotation_matrix(o.start.rotation), ground.normal);
        const auto distance_to_ground = [&](const Vec3<double>& point) {
            return surface_point(other.shape, other.start, transform(o.start, point)).distance;
        };
        const double lean =
            lean_at_foot(o.shape, local, up, ground.distance, before >= covered_mesh, travel, distance_to_ground);
        if (lean >= 0) return through + covered_mesh + lean;
    }
    return through;
}

/// Sides and overlaps of one lane's samples with one object.
template <class T>
void begin_samples(SkinChunk<T>& c, int slot, int lane, const SolverSettings& settings) {
    // What is deep as an object comes near is no contact's doing, and is undone slowly. Loads press contacts that deep,
    // too, in solves that end early: those are left to the solve.
    constexpr double begins = 1e-3, ends = 2e-5;
    const SkinTopology& t = *c.topology;
    LaneContact& o = c.contacts.at(slot, lane);
    ContactSlot& all = c.contacts.slot[std::size_t(slot)];
    const bool sided = has_sides(o.shape.kind), soft = o.stiffness > 0;
    // Not around what a solve moves, too, which is let go so and slips (test TurnedGrasp), nor where there are no
    // steps, for which platforms are matched: what is wrapped changes from one of these to the next.
    const bool wraps = o.body < 0 && settings.inertia;
    const bool stands = o.shape.kind == ShapeKind::mesh && !soft && c.contacts.count[std::size_t(lane)] > 1;
    o.shape.up = {0, 0, 0};
    all.sided |= sided;
    const Vec3<double> origin = origin_of_lane(c, lane);
    const double recovery = settings.recovery_speed * settings.dt;
    const bool curved = !t.skin_edges.empty();
    for (std::size_t s = 0; s < c.topology->sample_count(); ++s) {
        const std::size_t i =
            (std::size_t(slot) * c.topology->sample_count() + s) * std::size_t(c.width) + std::size_t(lane);
        T &side = c.state.contact_side[i], &offset = c.state.contact_offset[i];
        const bool touched = c.state.normal_multiplier[i] > 0 || offset < 0 || o.fresh;
        const bool bulges = curved && s < t.samples.size();
        if (!sided && !stands && !touched && !bulges) continue;
        const Vec3<double> x = origin + start_of_sample(c, s, lane);
        if (sided || stands) {
            const T* v = &c.state.velocity[std::size_t(3 * node_of_sample(t, s) * c.width + lane)];
            const Vec3<double> coasting{double(v[0]), double(v[c.width]), double(v[2 * c.width])};
            const Vec3<double> local = inverse_transform(o.start, x);
            const double travel = norm(inverse_transform(o.pose, x + settings.dt * coasting) - local);
            side = sided ? T(side_of_sample(c, slot, lane, s, local, int(side), travel, wraps))
                         : T(side_of_mesh(c, slot, lane, x, int(side), travel));
        }
        if (!bulges && (soft || !touched || !settings.inertia)) continue;
        const SurfacePoint<double> near = surface_point(o.shape, o.start, x, double(side));
        double depth = -near.distance;
        if (bulges) depth += set_rise(c, slot, lane, s, near.normal);
        if (soft || !touched || !settings.inertia) continue;
        const bool undo = offset < 0 ? depth > ends : o.fresh && depth > begins;
        offset = T(undo ? std::min(0.0, recovery - depth) : 0);
        all.recovers |= undo;
        if (undo) c.state.normal_multiplier[i] = 0;
    }
}

}  // namespace

template <class T>
void begin_slots(SkinChunk<T>& c, const SolverSettings& settings) {
    ContactSlots& s = c.contacts;
    const int W = c.width;
    s.used = *std::max_element(s.count.begin(), s.count.begin() + W);
    auto& w = c.scratch;
    for (int slot = 0; slot < s.used; ++slot) {
        ContactSlot& all = s.slot[std::size_t(slot)] = {};
        for (int lane = 0; lane < W; ++lane) {
            const LaneContact& o = s.at(slot, lane);
            const bool here = o.object >= 0, soft = here && o.stiffness > 0;
            const std::size_t i = std::size_t(slot * W + lane);
            w.slot_kind[i] = T(here ? int(o.shape.kind) : -1);
            for (int d = 0; d < 3; ++d) w.slot_size[std::size_t((3 * slot + d) * W + lane)] = T(o.shape.size[d]);
            w.slot_round[i] = T(o.shape.round);
            w.slot_friction[i] = T(o.friction);
            w.slot_stiffness[i] = T(o.stiffness);
            w.slot_body[i] = T(here && o.body >= 0);
            if (!here) continue;
            const unsigned bit = 1u << lane;
            all.lanes |= bit;
            all.of_kind[std::size_t(o.shape.kind)] |= bit;
            if (o.body >= 0) all.body_lanes |= bit;
            if (soft) all.soft_lanes |= bit;
            all.friction |= c.has_friction && o.friction > 0;
            begin_samples(c, slot, lane, settings);
        }
    }
    place_slots(c);
}

template <class T>
void place_slots(SkinChunk<T>& c) {
    const int W = c.width;
    for (int slot = 0; slot < c.contacts.used; ++slot)
        for (int lane = 0; lane < W; ++lane) {
            const LaneContact& o = c.contacts.at(slot, lane);
            if (o.object < 0) continue;
            T* out = &c.scratch.slot_frame[24 * std::size_t(slot) * W + std::size_t(lane)];
            for (const Pose<double>* pose : {&o.pose, &o.start}) {
                const Mat3<double> R = rotation_matrix(pose->rotation);
                for (int i = 0; i < 12; ++i)
                    out[i * W] =
                        T(i < 9 ? R.m[i / 3][i % 3] : pose->position[i - 9] - c.state.origin[(i - 9) * W + lane]);
                out += 12 * W;
            }
        }
}

template <class T>
void end_slots(SkinChunk<T>& c, const SolverSettings& settings) {
    const SkinTopology& t = *c.topology;
    for (int slot = 0; slot < c.contacts.used; ++slot) {
        if (!c.contacts.slot[std::size_t(slot)].recovers) continue;
        for (int lane = 0; lane < c.width; ++lane) {
            const LaneContact& o = c.contacts.at(slot, lane);
            if (o.object < 0 || !((active_lanes(c) >> lane) & 1u)) continue;
            SkinStatus& status = c.status[std::size_t(lane)];
            for (std::size_t k = 0; k < t.samples.size(); ++k) {
                const std::size_t i =
                    (std::size_t(slot) * t.sample_count() + k) * std::size_t(c.width) + std::size_t(lane);
                const double left = -double(c.state.contact_offset[i]);
                if (!(left > 0)) continue;
                status.converged = false;
                status.penetration_m = std::max(status.penetration_m, left);
                const Vec3<double> x = node_position(c, t.samples[k], lane);
                const Vec3<double> n = surface_point(o.shape, o.pose, x, double(c.state.contact_side[i])).normal;
                T* v = &c.state.velocity[std::size_t(3 * t.samples[k] * c.width + lane)];
                const double out = v[0] * n.x + v[c.width] * n.y + v[2 * c.width] * n.z;
                const double taken = std::clamp(out, 0.0, 2 * settings.recovery_speed);
                for (int d = 0; d < 3; ++d) v[d * c.width] -= T(taken * n[d]);
            }
        }
    }
}

template <class T>
bool near_sides(const SkinChunk<T>& c) {
    for (int lane = 0; lane < c.width; ++lane)
        for (int slot = 0; slot < c.contacts.count[std::size_t(lane)]; ++slot)
            if (has_sides(c.contacts.at(slot, lane).shape.kind)) return true;
    return false;
}

template <class T>
unsigned near_lanes(const SkinChunk<T>& c) {
    unsigned lanes = c.soft_lanes;
    for (int lane = 0; lane < c.width; ++lane)
        if (c.contacts.count[std::size_t(lane)] > 0) lanes |= 1u << lane;
    return lanes;
}

template <class T>
unsigned coupled_lanes(const SkinChunk<T>& c) {
    unsigned lanes = c.soft_lanes;
    for (int lane = 0; lane < c.width; ++lane)
        for (int slot = 0; slot < c.contacts.count[std::size_t(lane)]; ++slot)
            if (c.contacts.at(slot, lane).body >= 0) lanes |= 1u << lane;
    return lanes;
}

template <class T>
bool solved_with_others(const SkinChunk<T>& c) {
    return coupled_lanes(c) != 0;
}

#define PALPATE_INSTANTIATE(T)                                                 \
    template bool insert_contact(SkinChunk<T>&, int, int, const LaneContact&); \
    template void erase_contact(SkinChunk<T>&, int, int);                      \
    template void move_contacts(SkinChunk<T>&, int, SkinChunk<T>&, int);       \
    template void begin_slots(SkinChunk<T>&, const SolverSettings&);           \
    template void end_slots(SkinChunk<T>&, const SolverSettings&);             \
    template void place_slots(SkinChunk<T>&);                                  \
    template bool near_sides(const SkinChunk<T>&);                             \
    template unsigned near_lanes(const SkinChunk<T>&);                         \
    template unsigned coupled_lanes(const SkinChunk<T>&);                      \
    template bool solved_with_others(const SkinChunk<T>&);
PALPATE_INSTANTIATE(double)
PALPATE_INSTANTIATE(float)
#undef PALPATE_INSTANTIATE

}  // namespace palpate
