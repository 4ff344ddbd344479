#include "engine/contact/crossed_skin.h"

#include <algorithm>
#include <cmath>

#include "engine/systems.h"

namespace palpate {

namespace {

/// An object's surface is looked for so far behind a node [m]; as a share of the pad's longest edge, how deep it must
/// be, how far it may move in a step before it might have come through, and which radius lets it through slowly, too (a
/// ball of 7 mm was pressed in between nodes 6 mm apart).
constexpr double within = 4e-3, deep = 0.25, fast = 0.25, narrow = 2;

/// The straight way of a node leads through an object where it begins and ends no deeper than `outside` [m], where the
/// surface looks the other way at its end (cosine of the normals below `opposite`), and where it is deeper than `leap`
/// [m] and half of what bone and object moved past each other.
constexpr double outside = 1e-4, opposite = -0.5, leap = 1e-3;
constexpr int parts_of_way = 16;

template <class T>
bool touches(const SkinChunk<T>& c, int lane, int slot, std::size_t sample) {
    const std::size_t i = std::size_t(slot) * c.topology->sample_count() + sample;
    return c.state.normal_multiplier[i * std::size_t(c.width) + std::size_t(lane)] > 0;
}

/// How far a finger's bone and an object moved past each other in this step [m].
template <class T>
double travel(const SkinChunk<T>& c, int lane, const LaneContact& o) {
    Vec3<double> displacement;
    for (int d = 0; d < 3; ++d) {
        const std::size_t i = std::size_t(d * c.width + lane);
        displacement[d] = double(c.state.bone[i]) - double(c.scratch.start_bone[i]);
    }
    return norm(displacement - (o.pose.position - o.start.position));
}

/// Of what a finger may be on both sides of, where it began so or came through: its rest touches as if nothing were
/// [m].
double thickness(const Shape& shape) {
    if (shape.kind == ShapeKind::box) return 2 * std::min({shape.size.x, shape.size.y, shape.size.z});
    return shape.kind == ShapeKind::cylinder ? 2 * shape.size.y : HUGE_VAL;
}

/// How far a point on a box or a cylinder is from the nearest of its edges [m].
double distance_to_edge(const Shape& shape, const Vec3<double>& x) {
    if (shape.kind == ShapeKind::cylinder) {
        const double beside = shape.size.x - std::hypot(x.x, x.y), over = shape.size.y - std::abs(x.z);
        return std::max(std::abs(beside), std::abs(over));
    }
    double gap[3];
    for (int d = 0; d < 3; ++d) gap[d] = std::abs(shape.size[d] - std::abs(x[d]));
    return std::max(std::min(gap[0], gap[1]), std::min(std::max(gap[0], gap[1]), gap[2]));
}

/// Whether an object could be between samples.
template <class T>
bool may_be_behind(const SkinChunk<T>& c, int lane, int slot, const ContactSurface& surface) {
    const LaneContact& o = c.contacts.at(slot, lane);
    if (o.finger >= 0 || o.stiffness > 0 || o.shape.kind == ShapeKind::plane) return false;
    const double edge = surface.longest_edge;
    if (travel(c, lane, o) > fast * edge) return true;
    if (o.shape.kind == ShapeKind::mesh) return false;
    if (o.shape.kind != ShapeKind::box && o.shape.size.x < narrow * edge) return true;
    if (thickness(o.shape) < edge) return true;
    bool touched = false;
    for (std::size_t s = 0; s < c.topology->samples.size(); ++s) {
        if (!touches(c, lane, slot, s)) continue;
        touched = true;
        if (!has_sides(o.shape.kind)) return false;
        const Vec3<double> x = transform(surface.bone, surface.position[s]);
        if (distance_to_edge(o.shape, inverse_transform(o.pose, x)) < edge) return true;
    }
    return !touched;
}

double distance_to_segment(const Vec3<double>& p, const Vec3<double>& a, const Vec3<double>& b) {
    const Vec3<double> ab = b - a;
    const double along = std::clamp(dot(p - a, ab) / std::max(dot(ab, ab), 1e-300), 0.0, 1.0);
    return norm(p - a - along * ab);
}

double distance_to_face(const Vec3<double>& p, const Vec3<double>& a, const Vec3<double>& b, const Vec3<double>& c) {
    const Vec3<double> n = cross(b - a, c - a);
    const bool over =
        dot(cross(b - a, p - a), n) >= 0 && dot(cross(c - b, p - b), n) >= 0 && dot(cross(a - c, p - c), n) >= 0;
    const double to_face = over && dot(n, n) > 0 ? std::abs(dot(p - a, n)) / norm(n) : HUGE_VAL;
    return std::min(
        {to_face, distance_to_segment(p, a, b), distance_to_segment(p, b, c), distance_to_segment(p, c, a)});
}

/// Of a point from the pad's faces, in the finger's frame [m].
double distance_to_pad(const ContactSurface& surface, const Vec3<double>& p) {
    double least = HUGE_VAL;
    for (const auto& f : surface.faces)
        least =
            std::min(least, distance_to_face(p, surface.position[std::size_t(f[0])],
                                             surface.position[std::size_t(f[1])], surface.position[std::size_t(f[2])]));
    return least;
}

/// Of a point from all of the skin, world [m]: what has come in a little beside the pad is not deep because the pad is
/// far.
template <class T>
double distance_to_skin(const SkinChunk<T>& c, int lane, const ContactSurface& surface, const Vec3<double>& point) {
    double least = distance_to_pad(surface, inverse_transform(surface.bone, point));
    for (const auto* faces : {&surface.rim_faces, &surface.back_faces})
        for (const auto& f : *faces)
            least = std::min(least, distance_to_face(point, node_position(c, f[0], lane), node_position(c, f[1], lane),
                                                     node_position(c, f[2], lane)));
    return least;
}

/// Whether a point (world) is inside an element.
template <class T>
bool in_tissue(const SkinChunk<T>& c, int lane, const Vec3<double>& point) {
    const Vec3<double> p = point - lane_origin(c, lane);
    auto node = [&](int i) {
        const T* x = &c.state.position[std::size_t(3 * i * c.width + lane)];
        return Vec3<double>{double(x[0]), double(x[c.width]), double(x[2 * c.width])} - p;
    };
    auto volume = [](const Vec3<double>& a, const Vec3<double>& b, const Vec3<double>& d) {
        return dot(a, cross(b, d));
    };
    return std::any_of(c.topology->elements.begin(), c.topology->elements.end(), [&](const auto& t) {
        const Vec3<double> x = node(t[0]), y = node(t[1]), z = node(t[2]), w = node(t[3]);
        // Parts that the point cuts off: all of one sign where it is inside, whatever the order of the nodes.
        const double a = volume(y, z, w), b = -volume(x, z, w), d = volume(x, y, w), e = -volume(x, y, z);
        return (a > 0 && b > 0 && d > 0 && e > 0) || (a < 0 && b < 0 && d < 0 && e < 0);
    });
}

/// Outward normal of all the skin around a node of the pad, world, as long as twice an area. At the pad's rim half of
/// that skin is none of the pad's, and what the pad has of it looks aside.
template <class T>
Vec3<double> outward_at(const SkinChunk<T>& c, int lane, const ContactSurface& surface, std::size_t s) {
    Vec3<double> outward = rotation_matrix(surface.bone.rotation) * lane_outward(c, lane)[s];
    const int node = c.topology->samples[s];
    for (const auto& f : surface.rim_faces) {
        if (f[0] != node && f[1] != node && f[2] != node) continue;
        const Vec3<double> a = node_position(c, f[0], lane);
        outward += cross(node_position(c, f[1], lane) - a, node_position(c, f[2], lane) - a);
    }
    return outward;
}

/// Whether an object's surface nearest to a node lies straight inward from it, and deep in the tissue: where skin that
/// is pressed in stands up beside what presses, the object behind that wall is outside again.
template <class T>
bool is_behind(const SkinChunk<T>& c, int lane, const LaneContact& o, const ContactSurface& surface, std::size_t s) {
    constexpr double straight = 0.5;
    const Vec3<double> x = transform(surface.bone, surface.position[s]);
    const SurfacePoint<double> near = surface_point(o.shape, o.pose, x);
    if (near.distance > within || near.distance < -1e-4) return false;
    const auto is_straight = [&](const Vec3<double>& outward) {
        return dot(near.normal, outward) > straight * norm(outward);
    };
    const bool of_pad = is_straight(rotation_matrix(surface.bone.rotation) * lane_outward(c, lane)[s]);
    if (!of_pad && !is_straight(outward_at(c, lane, surface, s))) return false;
    const Vec3<double> there = x - near.distance * near.normal;
    if (!in_tissue(c, lane, there)) return false;
    const double depth = of_pad ? distance_to_pad(surface, inverse_transform(surface.bone, there))
                                : distance_to_skin(c, lane, surface, there);
    return depth > deep * surface.longest_edge;
}

/// Whether the middle of something round and narrow is inside the tissue, where it is nearest to the nodes around it:
/// those beside it are pressed aside then, and none straight outward.
template <class T>
bool has_middle_inside(const SkinChunk<T>& c, int lane, const LaneContact& o, const ContactSurface& surface) {
    if (o.shape.kind == ShapeKind::box || o.shape.kind == ShapeKind::mesh) return false;
    if (o.shape.size.x >= narrow * surface.longest_edge) return false;
    Vec3<double> middle{0, 0, 0};
    int near = 0;
    for (const Vec3<double>& position : surface.position) {
        const Vec3<double> x = inverse_transform(o.pose, transform(surface.bone, position));
        if (local_surface_point(o.shape, x).distance > within) continue;
        middle += x;
        ++near;
    }
    if (near == 0) return false;
    const double half = o.shape.kind == ShapeKind::sphere ? 0 : o.shape.size.y;
    return in_tissue(c, lane, transform(o.pose, {0, 0, std::clamp(middle.z / near, -half, half)}));
}

/// Calls visit(corner) for the corners of a box or a mesh (object's frame).
template <class Visit>
void for_each_corner(const Shape& shape, Visit visit) {
    if (shape.kind == ShapeKind::mesh)
        for (const Vec3<double>& corner : shape.mesh->corners) visit(corner);
    if (shape.kind != ShapeKind::box) return;
    const Vec3<double>& half = shape.size;
    for (int k = 0; k < 8; ++k)
        visit(Vec3<double>{k & 1 ? half.x : -half.x, k & 2 ? half.y : -half.y, k & 4 ? half.z : -half.z});
}

/// Corners of an object that are deep in the tissue: one that comes in between nodes, or beside the pad, presses on
/// none of them, and lies behind none.
template <class T>
int corners_inside(const SkinChunk<T>& c, int lane, const LaneContact& o, const ContactSurface& surface) {
    if (o.finger >= 0 || o.stiffness > 0) return 0;
    Vec3<double> low{HUGE_VAL, HUGE_VAL, HUGE_VAL}, high = -low;
    int count = 0;
    for_each_corner(o.shape, [&](const Vec3<double>& corner) {
        if (low.x > high.x)
            for (const Vec3<double>& x : surface.position)
                for (int d = 0; d < 3; ++d) low[d] = std::min(low[d], x[d]), high[d] = std::max(high[d], x[d]);
        const Vec3<double> point = transform(o.pose, corner), p = inverse_transform(surface.bone, point);
        bool near = true;
        for (int d = 0; d < 3; ++d) near &= p[d] > low[d] && p[d] < high[d];
        if (!near || !in_tissue(c, lane, point)) return;
        const double depth =
            o.shape.kind == ShapeKind::mesh ? distance_to_pad(surface, p) : distance_to_skin(c, lane, surface, point);
        count += depth > deep * surface.longest_edge;
    });
    return count;
}

/// Places inside an object, half way from its middle outward, and the middle itself (object's frame).
template <class Visit>
bool any_inner_point(const Shape& shape, Visit visit) {
    if (shape.kind == ShapeKind::plane) return false;
    if (shape.kind == ShapeKind::mesh) return visit(shape.mesh->centroid);
    const bool box = shape.kind == ShapeKind::box, ball = shape.kind == ShapeKind::sphere;
    const Vec3<double> half = 0.5 * (box ? shape.size : Vec3<double>{0, 0, ball ? 0 : shape.size.y});
    if (visit({0, 0, 0})) return true;
    for (int k = 0; k < 8; ++k)
        if (visit({k & 1 ? half.x : -half.x, k & 2 ? half.y : -half.y, k & 4 ? half.z : -half.z})) return true;
    return false;
}

/// Whether an object is inside a soft object's tissue, and has not merely dented it: a place inside of it is, or a
/// corner of a box, as deep as no flat face between nodes leaves it out.
bool is_in_tissue(const SkinChunk<double>& c, int lane, const LaneContact& o, const ContactSurface& surface) {
    const auto is_there = [&](const Vec3<double>& x) { return in_tissue(c, lane, transform(o.pose, x)); };
    if (any_inner_point(o.shape, is_there)) return true;
    bool deep_corner = false;
    if (o.shape.kind == ShapeKind::box)
        for_each_corner(o.shape, [&](const Vec3<double>& corner) {
            deep_corner |= is_there(corner) &&
                           distance_to_pad(surface, inverse_transform(surface.bone, transform(o.pose, corner))) >
                               deep * surface.longest_edge;
        });
    return deep_corner;
}

/// Whether the way from a to b (a mesh's frame) leads through a wall: steps along it are as long as the surface is far.
bool leads_through(const DistanceMesh& mesh, const Vec3<double>& a, const Vec3<double>& b) {
    constexpr double touching = 1e-6, shortest = 1.0 / 256;
    constexpr int most = 400;
    const Vec3<double> path = b - a;
    const double length = norm(path);
    bool inside = false;
    Vec3<double> entered{0, 0, 0};
    double at = 0;
    for (int step = 0; step < most; ++step) {
        const MeshPoint p = mesh_surface_distance(mesh, a + (at / length) * path);
        if (step == 0 && p.distance > length) return false;
        if (!inside && p.distance < touching && dot(p.normal, path) < 0) inside = true, entered = p.normal;
        if (inside && p.distance > -touching && dot(p.normal, path) > 0) {
            if (dot(p.normal, entered) < opposite) return true;
            inside = false;
        }
        if (at >= length) return false;
        at = std::min(length, at + std::max(std::abs(p.distance), shortest * length));
    }
    return false;
}

}  // namespace

template <class T>
int nodes_through_walls(SkinChunk<T>& c, int lane, const ContactSurface& surface) {
    const SkinTopology& t = *c.topology;
    int count = 0;
    for (int slot = 0; slot < c.contacts.count[std::size_t(lane)]; ++slot) {
        const LaneContact& o = c.contacts.at(slot, lane);
        if (o.finger >= 0 || o.stiffness > 0 || o.shape.kind != ShapeKind::mesh) continue;
        const bool moves = !c.status[std::size_t(lane)].reset && travel(c, lane, o) > fast * surface.longest_edge;
        for (std::size_t s = 0; s < t.samples.size(); ++s) {
            T& side = c.state.contact_side[(std::size_t(slot) * t.sample_count() + s) * std::size_t(c.width) +
                                           std::size_t(lane)];
            if (moves) {
                const T* x = &c.scratch.start_position[std::size_t(3 * t.samples[s] * c.width + lane)];
                const Vec3<double> before =
                    lane_origin(c, lane) + Vec3<double>{double(x[0]), double(x[c.width]), double(x[2 * c.width])};
                const Vec3<double> now = transform(surface.bone, surface.position[s]);
                if (leads_through(*o.shape.mesh, inverse_transform(o.start, before), inverse_transform(o.pose, now)))
                    side += int(side) % covered_mesh == 0 ? T(1) : T(-1);
            }
            count += int(side) % covered_mesh;
        }
    }
    return count;
}

/// Whether an object presses on any sample of a lane.
template <class T>
bool is_touched(const SkinChunk<T>& c, int lane, int slot) {
    const std::size_t S = c.topology->sample_count(), W = std::size_t(c.width);
    for (std::size_t s = 0; s < S; ++s)
        if (c.state.normal_multiplier[(std::size_t(slot) * S + s) * W + std::size_t(lane)] > 0) return true;
    return false;
}

template <class T>
int nodes_leapt(SkinChunk<T>& c, int lane, const ContactSurface& surface) {
    if (c.status[std::size_t(lane)].reset) {
        for (int slot = 0; slot < c.contacts.count[std::size_t(lane)]; ++slot) c.contacts.at(slot, lane).leapt = 0;
        return 0;
    }
    const SkinTopology& t = *c.topology;
    const auto before = [&](int node) {
        const T* x = &c.scratch.start_position[std::size_t(3 * node * c.width + lane)];
        return lane_origin(c, lane) + Vec3<double>{double(x[0]), double(x[c.width]), double(x[2 * c.width])};
    };
    double b[7];
    for (std::size_t k = 0; k < 7; ++k)
        b[k] = double(c.scratch.start_bone[k * std::size_t(c.width) + std::size_t(lane)]);
    const Pose<double> start{lane_origin(c, lane) + Vec3<double>{b[0], b[1], b[2]}, {b[3], b[4], b[5], b[6]}};
    T farthest(-1);  // squared, in the world: nearly always, nothing comes as far
    const auto find_farthest = [&] {
        for (const int node : t.samples) {
            T squared(0);
            for (int d = 0; d < 3; ++d) {
                const std::size_t i = std::size_t((3 * node + d) * c.width + lane);
                const T moved = c.state.position[i] - c.scratch.start_position[i];
                squared += moved * moved;
            }
            farthest = std::max(farthest, squared);
        }
    };
    int count = 0;
    for (int slot = 0; slot < c.contacts.count[std::size_t(lane)]; ++slot) {
        LaneContact& o = c.contacts.at(slot, lane);
        if (o.finger >= 0 || o.stiffness > 0 || o.shape.kind == ShapeKind::mesh || o.shape.kind == ShapeKind::plane)
            continue;
        if (o.leapt > 0 && !is_touched(c, lane, slot)) o.leapt = 0;
        count += o.leapt;
        const bool still = norm(o.pose.position - o.start.position) <= 0 &&
                           norm(o.pose.rotation.vector() - o.start.rotation.vector()) <= 0;
        if (still && farthest < 0) find_farthest();
        if (still && double(farthest) <= 4 * leap * leap) continue;
        for (std::size_t s = 0; s < t.samples.size(); ++s) {
            const Vec3<double> from = inverse_transform(o.start, before(t.samples[s])),
                               to = inverse_transform(o.pose, transform(surface.bone, surface.position[s])),
                               way = to - from;
            if (!(dot(way, way) > 4 * leap * leap)) continue;  // what is outside at both ends is not as deep between
            const SurfacePoint<double> at = local_surface_point(o.shape, from), ends = local_surface_point(o.shape, to);
            if (at.distance < -outside || ends.distance < -outside || dot(at.normal, ends.normal) > opposite) continue;
            const Vec3<double> carried =
                inverse_transform(o.pose, transform(surface.bone, inverse_transform(start, before(t.samples[s]))));
            const double deepest = leap + norm(carried - from) / 2;
            bool through = false;
            for (int k = 1; k < parts_of_way && !through; ++k)
                through = local_surface_point(o.shape, from + (double(k) / parts_of_way) * way).distance < -deepest;
            o.leapt += through, count += through;
        }
    }
    return count;
}

template <class T>
int nodes_behind(SkinChunk<T>& c, int lane, const ContactSurface& surface) {
    int count = 0;
    for (int slot = 0; slot < c.contacts.count[std::size_t(lane)]; ++slot) {
        LaneContact& o = c.contacts.at(slot, lane);
        count += corners_inside(c, lane, o, surface);
        if (!o.behind && !may_be_behind(c, lane, slot, surface)) continue;
        int behind = has_middle_inside(c, lane, o, surface);
        for (std::size_t s = 0; s < c.topology->samples.size(); ++s) behind += is_behind(c, lane, o, surface, s);
        o.behind = behind > 0;
        count += behind;
    }
    return count;
}

void find_entered_tissue(double time, SoftObjects& soft, SkinChunks& chunks, Table<RigidBody>& bodies) {
    for (SoftObject& s : soft.all) {
        SkinChunk<double>& c = chunks.doubles[std::size_t(s.skin.chunk)];
        SkinStatus& status = c.status[std::size_t(s.skin.lane)];
        int first = -1;
        for (int slot = 0; slot < c.contacts.count[std::size_t(s.skin.lane)]; ++slot) {
            const LaneContact& o = c.contacts.at(slot, s.skin.lane);
            if (o.finger >= 0 || o.stiffness > 0 || !is_in_tissue(c, s.skin.lane, o, s.surface)) continue;
            if (first < 0) first = o.object;
            ++status.wrong_sides;
            status.converged = false;
            if (o.body >= 0) bodies[std::size_t(o.body)].converged = false;
        }
        if (first < 0) continue;
        if (s.entered_steps++ == 0) s.entered_by = first, s.entered_at = time;
    }
}

template int nodes_through_walls(SkinChunk<double>&, int, const ContactSurface&);
template int nodes_through_walls(SkinChunk<float>&, int, const ContactSurface&);
template int nodes_leapt(SkinChunk<double>&, int, const ContactSurface&);
template int nodes_leapt(SkinChunk<float>&, int, const ContactSurface&);
template int nodes_behind(SkinChunk<double>&, int, const ContactSurface&);
template int nodes_behind(SkinChunk<float>&, int, const ContactSurface&);

}  // namespace palpate
