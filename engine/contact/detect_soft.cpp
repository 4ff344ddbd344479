// Which fingers are near soft objects, and which face of the deformed surface each of their samples is nearest to.

#include <algorithm>
#include <cmath>

#include "engine/systems.h"

namespace palpate {

namespace {

/// A sample that pressed keeps its face, and its force, until it is farther from the surface than this [m].
constexpr double kept_within = 0.02;

/// How far a lane may go in this step: with its bone's targets, and with its own speed [m].
template <class T>
double travel_of(const SkinChunk<T>& c, int lane, const SolverSettings& solver) {
    const auto W = std::size_t(c.width), l = std::size_t(lane);
    double travel2 = 0, speed2 = 0;
    for (std::size_t s = 0; s < bone_spring_count; ++s) {
        Vec3<double> d;
        for (std::size_t k = 0; k < 3; ++k)
            d[int(k)] = double(c.scratch.bone_springs[(9 * s + 2 + k) * W + l]) - double(c.state.bone[k * W + l]);
        travel2 = std::max(travel2, dot(d, d));
    }
    for (int node : c.topology->samples) {
        Vec3<double> v;
        for (int d = 0; d < 3; ++d) v[d] = double(c.state.velocity[std::size_t(3 * node + d) * W + l]);
        speed2 = std::max(speed2, dot(v, v));
    }
    return 2 * std::sqrt(travel2) + 2 * solver.dt * std::sqrt(speed2);
}

/// A point of a triangle.
struct FacePoint {
    Vec3<double> weight;  ///< barycentric
    Vec3<double> point;
    bool inside;      ///< not on an edge
    int corner = -1;  ///< the corner that it is; -1: none
};

/// The point of a triangle nearest to x (Ericson, Real-Time Collision Detection, 5.1.5).
FacePoint nearest_on_face(const Vec3<double>& x, const Vec3<double>& a, const Vec3<double>& b, const Vec3<double>& c) {
    auto at = [&](double u, double v, double w, bool inside, int corner = -1) {
        return FacePoint{{u, v, w}, u * a + v * b + w * c, inside, corner};
    };
    const Vec3<double> ab = b - a, ac = c - a, ax = x - a, bx = x - b, cx = x - c;
    const double d1 = dot(ab, ax), d2 = dot(ac, ax), d3 = dot(ab, bx), d4 = dot(ac, bx), d5 = dot(ab, cx),
                 d6 = dot(ac, cx);
    if (d1 <= 0 && d2 <= 0) return at(1, 0, 0, false, 0);
    if (d3 >= 0 && d4 <= d3) return at(0, 1, 0, false, 1);
    if (d6 >= 0 && d5 <= d6) return at(0, 0, 1, false, 2);
    const double va = d3 * d6 - d5 * d4, vb = d5 * d2 - d1 * d6, vc = d1 * d4 - d3 * d2;
    if (vc <= 0 && d1 >= 0 && d3 <= 0) return at(1 - d1 / (d1 - d3), d1 / (d1 - d3), 0, false);
    if (vb <= 0 && d2 >= 0 && d6 <= 0) return at(1 - d2 / (d2 - d6), 0, d2 / (d2 - d6), false);
    if (va <= 0 && d4 - d3 >= 0 && d5 - d6 >= 0) {
        const double t = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        return at(0, 1 - t, t, false);
    }
    const double sum = va + vb + vc;
    if (!(sum > 0)) return at(1, 0, 0, false, 0);
    return at(va / sum, vb / sum, vc / sum, true);
}

/// Where the faces of a soft object are now.
void read_surface(const SkinChunks& chunks, SoftObject& o) {
    o.low = {1e300, 1e300, 1e300}, o.high = {-1e300, -1e300, -1e300};
    const SkinChunk<double>& c = chunks.doubles[std::size_t(o.skin.chunk)];
    for (const auto& face : o.faces)
        for (int node : face) {
            const Vec3<double> x = o.nodes[std::size_t(node)] = node_position(c, node, o.skin.lane);
            for (int d = 0; d < 3; ++d) o.low[d] = std::min(o.low[d], x[d]), o.high[d] = std::max(o.high[d], x[d]);
        }
}

double distance_to_box(const Vec3<double>& x, const SoftObject& o) {
    Vec3<double> out;
    for (int d = 0; d < 3; ++d) out[d] = std::max({o.low[d] - x[d], 0.0, x[d] - o.high[d]});
    return norm(out);
}

/// Blocks of the Newton matrix for a stencil's nodes.
template <class T>
void find_blocks(const SkinChunk<T>& c, Stencil& s) {
    const SkinTopology& t = *c.topology;
    for (int k = 0, i = 0; i < s.count; ++i)
        for (int j = 0; j <= i; ++j, ++k) {
            const int a = t.elimination[std::size_t(s.node[std::size_t(i)])],
                      b = t.elimination[std::size_t(s.node[std::size_t(j)])];
            s.block[std::size_t(k)] = a < 0 || b < 0 ? -1 : t.pattern.find(std::max(a, b), std::min(a, b));
        }
}

template <class T>
Stencil stencil_of_sample(const SkinChunk<T>& c, std::size_t s) {
    const SkinTopology& t = *c.topology;
    Stencil out;
    if (s < t.samples.size()) {
        out.count = 1, out.node[0] = t.samples[s], out.weight[0] = 1;
        out.block[0] = t.elimination[std::size_t(t.samples[s])] < 0 ? -1 : t.diagonal_block[std::size_t(t.samples[s])];
        return out;
    }
    const FaceSample& f = t.face_samples[s - t.samples.size()];
    out.count = 3, out.node = f.node, out.weight = f.weight, out.block = f.block;
    return out;
}

/// A face's normal, weighted by the angle at one of its corners; at an edge by 1.
Vec3<double> weighted_normal(const std::array<Vec3<double>, 3>& at, int corner) {
    const Vec3<double> outward = cross(at[1] - at[0], at[2] - at[0]);
    const double area = norm(outward);
    if (!(area > 0)) return {0, 0, 0};
    double angle = 1;
    if (corner >= 0) {
        const std::size_t k = std::size_t(corner);
        const Vec3<double> u = at[(k + 1) % 3] - at[k], v = at[(k + 2) % 3] - at[k];
        angle = std::atan2(norm(cross(u, v)), dot(u, v));
    }
    return (angle / area) * outward;
}

/// The nearest face to x within `reach`; false where there is none. At an edge or a corner all faces that meet there
/// say together which side is outside (Baerentzen and Aanaes 2005, Signed distance computation using the angle
/// weighted pseudonormal): above the rim of a box, the side alone would say that x is inside.
bool find_face(const SoftObject& o, const Vec3<double>& x, double reach, Stencil& stencil, Vec3<double>& normal,
               Vec3<double>& on_face) {
    double best = reach * reach;
    bool found = false, inside = false;
    Vec3<double> own{0, 0, 0}, together{0, 0, 0};
    for (const auto& f : o.faces) {
        const std::array<Vec3<double>, 3> at{o.nodes[std::size_t(f[0])], o.nodes[std::size_t(f[1])],
                                             o.nodes[std::size_t(f[2])]};
        bool far = false;
        const double within = (1 + 1e-6) * std::sqrt(best);
        for (int d = 0; d < 3 && !far; ++d)
            far = std::min({at[0][d], at[1][d], at[2][d]}) - x[d] > within ||
                  x[d] - std::max({at[0][d], at[1][d], at[2][d]}) > within;
        if (far) continue;
        const FacePoint p = nearest_on_face(x, at[0], at[1], at[2]);
        const Vec3<double> apart = x - p.point;
        const double apart2 = dot(apart, apart);
        if (apart2 >= best) {
            // Faces that meet at the nearest point are as far, but for rounding.
            if (found && !inside && norm(p.point - on_face) < 1e-9) together += weighted_normal(at, p.corner);
            continue;
        }
        const Vec3<double> direction = weighted_normal(at, p.corner);
        const bool same = found && !inside && norm(p.point - on_face) < 1e-9;
        together = same ? together + direction : direction;
        best = apart2;
        found = true, inside = p.inside;
        stencil.count = 3, stencil.node = f, stencil.weight = {p.weight.x, p.weight.y, p.weight.z};
        on_face = p.point;
        own = direction;
    }
    if (!found) return false;
    // At an edge the way to the surface is the normal, unless it is too short to tell.
    const Vec3<double> offset = x - on_face;
    const double length = norm(offset), size = norm(own);
    normal = size > 0 ? (1 / size) * own : Vec3<double>{0, 0, 1};
    if (!inside && length > 1e-6) normal = (dot(offset, together) < 0 ? -1 / length : 1 / length) * offset;
    return true;
}

/// The samples of a finger that may touch a soft object in this step. Returns whether any may.
template <class T>
bool find_samples(const SkinChunk<T>& c, int lane, const SoftObject& o, const SkinChunk<double>& soft, double travel,
                  SoftPair& pair) {
    const Sphere& reach = c.reach[std::size_t(lane)];
    bool any = false;
    const bool may = distance_to_box(reach.centre, o) < reach.radius + travel;
    for (std::size_t s = 0; s < pair.samples.size(); ++s) {
        SoftSample& p = pair.samples[s];
        const bool pressed = p.state.normal_multiplier > 0;
        p.near = false;
        if (may) {
            p.of_finger = stencil_of_sample(c, s);
            Vec3<double> x{0, 0, 0};
            for (std::size_t k = 0; k < std::size_t(p.of_finger.count); ++k)
                x += p.of_finger.weight[k] * node_position(c, p.of_finger.node[k], lane);
            const double within = pressed ? std::max(kept_within, 1e-3 + travel) : 1e-3 + travel;
            Vec3<double> on_face;
            p.near = distance_to_box(x, o) < within && find_face(o, x, within, p.of_face, p.normal, on_face);
            if (p.near) {
                find_blocks(soft, p.of_face);
                p.finger_start = x, p.face_start = on_face;
                // Friction lies in the tangent plane of the surface as it is now.
                p.state.friction_normal = p.normal;
                any = true;
                continue;
            }
        }
        p.state = {0, {0, 0, 0}, 0, p.normal};
        p.terms = {0, {0, 0, 0}, Mat3<double>::zero(), 0, {0, 0, 0}};
    }
    return any;
}

}  // namespace

void detect_soft_contacts(const Table<VirtualObject>& shapes, const Table<Skin>& skins, const SolverSettings& solver,
                          SoftObjects& soft, SkinChunks& chunks) {
    if (soft.all.empty()) return;
    chunks.for_each([](auto& c) { c.soft_lanes = 0; });
    for (SoftObject& o : soft.all) read_surface(chunks, o);
    for (SoftPair& pair : soft.pairs) {
        const Skin& finger = skins[std::size_t(pair.finger)];
        SoftObject& o = soft.all[std::size_t(pair.soft)];
        SkinChunk<double>& own = chunks.doubles[std::size_t(o.skin.chunk)];
        chunks.with(finger.single_precision, finger.chunk, [&](auto& c) {
            // Skin that moves with its bone has no velocities of its own; its reach has them.
            const bool rigid = (c.rigid_lanes >> finger.lane) & 1u;
            const double travel =
                travel_of(own, o.skin.lane, solver) +
                (rigid ? c.reach[std::size_t(finger.lane)].radius - c.rest_reach[std::size_t(finger.lane)].radius
                       : travel_of(c, finger.lane, solver));
            pair.friction = shapes[std::size_t(o.object)].friction;
            if (const auto& given = c.rest.object_friction; !given.empty())
                pair.friction = double(given[std::size_t(o.object * c.width + finger.lane)]);
            pair.near = find_samples(c, finger.lane, o, own, travel, pair);
            if (!pair.near) return;
            c.soft_lanes |= 1u << finger.lane, own.soft_lanes |= 1u << o.skin.lane;
            // What they add to each other's matrices is not followed in kept ones: one from before is none any more.
            auto forget = [](auto& of, int lane) {
                auto& kept = of.state.matrix_kept[std::size_t(lane)];
                kept = std::min(kept, decltype(kept + 0)(0));
            };
            forget(c, finger.lane), forget(own, o.skin.lane);
        });
    }
}

}  // namespace palpate
