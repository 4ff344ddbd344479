#pragma once
// When a point remembers the side of an object that it was on.

#include <algorithm>
#include <cmath>

#include "engine/contact/fitted.h"
#include "engine/contact/shape.h"

namespace palpate {

/// The side (side_of) of a point that may move by `travel` [m] in this step, seen from the object; 0 where the object
/// is thick enough for the nearest face to be the right one. A body that turns between fingers must be free to leave
/// them.
inline int side_in_step(const Shape& shape, const Vec3<double>& x, int before, double travel) {
    const int side = side_of(shape, x, before);
    if (side == 0) return 0;
    const int axis = (side < 0 ? -side : side) - 1;
    const double half = shape.kind == ShapeKind::cylinder ? shape.size.y : shape.size[axis];
    return half > fitted::thin_half && travel < half ? 0 : side;
}

/// What is added to the number of a side where it is strict, and for each of the axes along which it is bridged
/// (sided_point).
inline constexpr int strict_side = 3;

/// What is added to the number of a face that something covers: a point there is on no side.
inline constexpr int covered_face = 15;

/// A side without what makes it strict.
inline int plain_side(int side) {
    return std::abs(side) > covered_face || side == 0 ? 0 : side < 0 ? -1 - (-1 - side) % 3 : 1 + (side - 1) % 3;
}
inline int add_to_side(int side, int more) { return side < 0 ? side - more : side + more; }

/// The face of a box or a cylinder that skin looks at whose outward normal is `outward` (object's frame): of a cylinder
/// one of its ends.
inline int face_towards(const Shape& shape, const Vec3<double>& outward) {
    int axis = 2;
    if (shape.kind == ShapeKind::box)
        for (int i = 0; i < 2; ++i)
            if (std::abs(outward[i]) > std::abs(outward[axis])) axis = i;
    return (outward[axis] < 0 ? 1 : -1) * (axis + 1);
}

/// The side of a point of skin at an edge that the skin wraps; 0 where there is none. Skin is straight between its
/// points, so that of two with an edge between them one lies on the face that the skin looks at, and the other below
/// it, at the wall beside it. What presses on skin presses along the skin's normal, and there that is the face's: held
/// by the wall, the skin would hang at the edge (a ridge 1 mm high that is drawn under a finger, without friction:
/// 24 N). The face, a strict side, is bridged towards the wall; on the face it is so already where it may come to the
/// rim in this step (`travel`), or what came over the rim would fall beside the wall, and be lifted again, by turns (a
/// finger on an edge: steps of 200 iterations, from a place where the wall's plane was a cliff of potential).
/// `any(is)`: whether is(p) holds of any point p of the skin (object's frame).
template <class AnyPoint>
int side_round_edge(const Shape& shape, const Vec3<double>& x, const Vec3<double>& outward, int before, double travel,
                    AnyPoint any) {
    const int face = face_towards(shape, outward), axis = std::abs(face) - 1, towards = face < 0 ? -1 : 1;
    const bool disc = shape.kind == ShapeKind::cylinder;
    const double half = disc ? shape.size.y : shape.size[axis], depth = half - towards * x[axis];
    if (!(depth > -fitted::on_face) || depth > fitted::wraps_below || before == -face) return 0;
    if (std::abs(outward[axis]) < fitted::looks_at_face) return 0;
    const double radius = disc ? std::hypot(x.x, x.y) : 0;
    const bool on = depth <= fitted::on_face;
    const double before_wall = on ? fitted::at_rim + std::min(travel, fitted::bridge) : fitted::on_face,
                 behind_wall = on ? fitted::at_rim : fitted::on_face;
    int along = 0;
    for (int k = 1; k < 3 && along == 0; ++k) {
        const int i = (axis + k) % 3;
        const double beside = disc ? radius - shape.size.x : std::abs(x[i]) - shape.size[i];
        if (beside > -before_wall && beside < behind_wall) along = disc ? 3 : k;
    }
    if (along == 0) return 0;
    const auto is_on_face = [&](const Vec3<double>& p) {
        const Vec3<double> way = p - x;
        if (std::abs(half - towards * p[axis]) > fitted::on_face || norm(way) > fitted::wraps_within) return false;
        if (disc) return std::hypot(p.x, p.y) < shape.size.x;
        return std::abs(p[(axis + 1) % 3]) < shape.size[(axis + 1) % 3] &&
               std::abs(p[(axis + 2) % 3]) < shape.size[(axis + 2) % 3];
    };
    return any(is_on_face) ? add_to_side(face, (1 + along) * strict_side) : 0;
}

/// The same for a point of a surface, as of skin, whose outward normal is `outward` (object's frame; zero: it has
/// none): where it lies on a face, or no deeper in it than a solve leaves it, and looks at it, that face is the way out
/// (a strict side), and not another one that happens to be nearer. What slides from one object onto another that lies
/// flush with it would else hang at the face between the two, which is none of what they are together.
inline int side_of_surface(const Shape& shape, const Vec3<double>& x, const Vec3<double>& outward, int before,
                           double travel) {
    const int side = side_in_step(shape, x, plain_side(before), travel);
    const int face = face_towards(shape, outward), axis = std::abs(face) - 1, towards = face < 0 ? -1 : 1;
    if (side != 0 && side != face) return side;
    const bool disc = shape.kind == ShapeKind::cylinder;
    const double half = disc ? shape.size.y : shape.size[axis];
    // What may come over all of the face in one step may as well come in beside it.
    const double across = disc ? shape.size.x : std::min(shape.size[(axis + 1) % 3], shape.size[(axis + 2) % 3]);
    const bool looks = std::abs(outward[axis]) > fitted::looks_at_face, on = towards * x[axis] > half - fitted::on_face;
    return looks && on && travel < across ? add_to_side(face, strict_side) : side;
}

/// The side of a point of a surface that side_of_surface gives none, for what it is on is thick, and its way short:
/// that of the nearest face, which says nothing as long as the point is on that face's half of the shape. Tissue that
/// is wound up by a blow leaps by far more than its way foretells, and where it leapt past the middle, the face behind
/// was the nearest, and pulled it through (random scene 2101443: 4.8 mm in a step of 1 ms, through a box of 5.6 mm).
/// Only what is inside keeps the side it had: what slides from face to face is on another one by now.
inline int side_of_thick(const Shape& shape, const Vec3<double>& x, int before) {
    const bool inside = local_surface_point(shape, x).distance < -fitted::on_face;
    return side_of(shape, x, inside ? before : 0);
}

/// A strict side, bridged where something level with it goes on beyond its rim, next to a point that may come there in
/// this step: `goes_on(point)` says whether another object is at a point (object's frame), which is as far beyond the
/// rim as a bridge may reach, and a little below it.
template <class GoesOn>
int bridge_side(const Shape& shape, const Vec3<double>& x, int side, double travel, GoesOn goes_on) {
    const int plain = plain_side(side), axis = std::abs(plain) - 1;
    const double least = -travel - fitted::bridge;
    const double half = shape.kind == ShapeKind::cylinder ? shape.size.y : shape.size[axis];
    if (std::abs(x[axis]) - half > -least) return side;  // it comes nowhere near
    auto is_level = [&](Vec3<double> p) {
        p[axis] = (plain < 0 ? -1 : 1) * (half - fitted::level);
        return goes_on(p);
    };
    int along = 0;
    if (shape.kind == ShapeKind::cylinder) {
        const double beside = std::hypot(x.x, x.y), share = (shape.size.x + fitted::bridge) / std::max(beside, 1e-9);
        if (beside - shape.size.x > least && is_level({share * x.x, share * x.y, 0})) along = 3;
        return add_to_side(side, strict_side * along);
    }
    for (int k = 1; k < 3; ++k) {
        const int i = (axis + k) % 3;
        if (std::abs(x[i]) - shape.size[i] < least) continue;
        Vec3<double> p = x;
        p[i] = (x[i] < 0 ? -1 : 1) * (shape.size[i] + fitted::bridge);
        if (is_level(p)) along += k;
    }
    return add_to_side(side, strict_side * along);
}

/// The side of a point, or the face near it that is no way out, since something else begins right behind it (as a table
/// under a box): what slides on the table into the box's wall is as near to the box's bottom as it can be, and would
/// pass under it. `is_covered(point)` says whether a point (object's frame) is well inside another object. Skin
/// whose outward normal is against a face lies on it, and not on what covers it. What knows that it is on another side
/// (a strict one, or the opposite face of something thin) keeps that.
template <class IsCovered>
int cover_side(const Shape& shape, const Vec3<double>& x, const Vec3<double>& outward, int side, double travel,
               IsCovered is_covered) {
    if (!has_sides(shape.kind) || side != plain_side(side)) return side;
    const bool disc = shape.kind == ShapeKind::cylinder;
    const double near = travel + fitted::bridge;
    for (int axis = disc ? 2 : 0; axis < 3; ++axis) {
        const double half = disc ? shape.size.y : shape.size[axis];
        const int towards = x[axis] < 0 ? -1 : 1, face = towards * (axis + 1);
        const double over = towards * x[axis] - half;
        if (over < -fitted::bridge || over > fitted::level || side == -face) continue;
        if (towards * outward[axis] < -fitted::against_face) continue;
        Vec3<double> p = x;
        p[axis] = towards * (half + fitted::level);
        if (disc) {
            const double beside = std::hypot(x.x, x.y), most = shape.size.x - fitted::level;
            if (beside - shape.size.x > near) continue;
            if (beside > most) p.x *= most / beside, p.y *= most / beside;
        } else {
            const int next = (axis + 1) % 3, last = (axis + 2) % 3;
            if (std::abs(x[next]) - shape.size[next] > near || std::abs(x[last]) - shape.size[last] > near) continue;
            for (int i : {next, last}) {
                const double most = std::max(shape.size[i] - fitted::level, 0.0);
                p[i] = std::clamp(x[i], -most, most);
            }
        }
        if (is_covered(p)) return add_to_side(face, covered_face);
    }
    return side;
}

/// A side that a point is on from outside, well within the face: a strict one, for what leaps in a step to where
/// another face is nearer has still come in by this one (1.2 mm in 1 ms, where skin that had hung at an edge was let
/// go).
inline int wall_side(const Shape& shape, const Vec3<double>& x, int side) {
    if (side == 0 || side != plain_side(side)) return side;
    const int axis = std::abs(side) - 1;
    const bool disc = shape.kind == ShapeKind::cylinder;
    const double half = disc ? shape.size.y : shape.size[axis], rim = 2 * fitted::level;
    if ((side < 0 ? -1 : 1) * x[axis] < half - fitted::on_face) return side;
    if (disc) return std::hypot(x.x, x.y) < shape.size.x - rim ? add_to_side(side, strict_side) : side;
    for (int k = 1; k < 3; ++k)
        if (std::abs(x[(axis + k) % 3]) > shape.size[(axis + k) % 3] - rim) return side;
    return add_to_side(side, strict_side);
}

/// How far the wall of a mesh that stands on something leans back (the cosine between its normal and the way up; 0:
/// not, or it overhangs) where a point x is at its foot (covered_mesh); below 0: it is not. The surface that it stands
/// on is `over` [m] below the point, `up` the way from it: the mesh comes down to there, and its wall is where it is
/// asked instead, at shape.foot, which is set where there is none yet (shape.up is 0). What comes from outside is at a
/// foot; below a mesh that is round, or has a round edge, skin comes in as far as there is room.
/// `distance_to_ground(point)`: from what it stands on; all in the mesh's frame.
template <class DistanceToGround>
double lean_at_foot(Shape& shape, const Vec3<double>& x, const Vec3<double>& up, double over, bool before,
                    double travel, DistanceToGround distance_to_ground) {
    const DistanceMesh& mesh = *shape.mesh;
    const bool first = !(norm(shape.up) > 0);
    // As high as edges of the smooth field are round, or as half of the mesh is high.
    const double highest = std::max(fitted::round_foot * mesh.cell, fitted::bridge);
    if (over > highest || over < -fitted::bridge / 2) return -1;
    if (!first && dot(up, shape.up) < fitted::one_ground) return -1;
    if (mesh_surface_distance(mesh, x).distance > travel + fitted::bridge) return -1;
    const Vec3<double> ground = x - over * up;
    const MeshPoint nearest = mesh_distance(mesh, ground);
    if (std::abs(distance_to_ground(ground - nearest.distance * nearest.normal)) > fitted::level) return -1;
    const auto lean_of_wall = [&](double height) {
        const MeshPoint p = mesh_distance(mesh, ground + height * up);
        const double lean = dot(p.normal, up);
        if (std::abs(lean) >= fitted::steep_wall || (!before && p.distance <= -fitted::bridge / 2)) return -1.0;
        return std::max(lean, 0.0);
    };
    if (!first) return lean_of_wall(shape.foot - dot(shape.up, ground));
    for (double height = highest; height > fitted::level; height /= 2)
        if (const double lean = lean_of_wall(height); lean >= 0) {
            shape.up = up, shape.foot = dot(up, ground) + height;
            return lean;
        }
    return -1;
}

}  // namespace palpate
