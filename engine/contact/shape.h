#pragma once
// Virtual objects as signed distances with exact normals.

#include "engine/contact/fitted.h"
#include "engine/contact/mesh_distance.h"
#include "engine/math/pose.h"

namespace palpate {

enum class ShapeKind { plane, box, sphere, capsule, cylinder, mesh };

/// Dimensions by kind, in the object's frame:
/// plane: none, surface z = 0, outside z > 0; box: half extents x, y, z; sphere: {radius};
/// capsule and cylinder: {radius, half length of the axis along z} (a capsule's caps come on top); mesh: none.
struct Shape {
    ShapeKind kind = ShapeKind::plane;
    Vec3<double> size{0, 0, 0};          ///< [m]
    const DistanceMesh* mesh = nullptr;  ///< of kind mesh; owned by the object
    double round = 0;                    ///< radius of a box's edges, or of a cylinder's rims [m]
    /// Of a mesh that stands on something, for points at its foot (covered_mesh): the way up from there, of length one,
    /// and how far up its walls go straight down, from the mesh's origin [m].
    Vec3<double> up{0, 0, 0};
    double foot = 0;
};

template <class R>
struct SurfacePoint {
    R distance;      ///< [m] negative inside
    Vec3<R> normal;  ///< unit gradient of the distance
};

namespace detail {

template <class R>
inline SurfacePoint<R> sphere_point(const Vec3<R>& offset, const R& radius) {
    const R length = norm(offset);
    const MaskOf<R> centre = length <= R(0);
    const R inverse = R(1) / select(centre, R(1), length);
    return {length - radius, select(centre, Vec3<R>{R(0), R(0), R(1)}, inverse * offset)};
}

/// Box around the origin: outside, the distance to the nearest face, edge or corner; inside, to the
/// nearest face. For a point with a side (ContactSide) the box goes on for ever behind that face, and beyond its middle
/// that face is the way out: however far a step takes the point, it stays on the side it was on. For one with a strict
/// side that face is the way out wherever the point is inside; a bridged side reaches `bridge` beyond its rim, along
/// one other axis or both. A covered face is none: the box goes on beyond it for as much.
template <class R, bool sided = false>
inline SurfacePoint<R> box_point(const Vec3<R>& x, const Vec3<R>& half, const R& side = R(0)) {
    using T = ScalarOf<R>;
    const Vec3<R> zero{R(0), R(0), R(0)};
    Vec3<R> q = zero, sign = zero, positive = zero, exit = zero;
    MaskOf<R> beyond = R(1) < R(0);
    R through(0), number(0);
    MaskOf<R> strict = beyond, along_next = beyond, along_last = beyond;
    R covered(0);
    if constexpr (sided) {
        number = absolute(side);
        const MaskOf<R> covers = number > R(T(15.5));
        covered = select(covers, number - R(T(15)), R(0));
        number = select(covers, R(0), number);
        strict = number > R(T(3.5));
        along_last = number > R(T(9.5));
        const MaskOf<R> both = number > R(T(12.5)), bridged = number > R(T(6.5));
        along_next = both | (bridged & !along_last);
        const R more = select(both, R(T(12)), select(along_last, R(T(9)), select(bridged, R(T(6)), R(T(3)))));
        number = select(strict, number - more, number);
    }
    auto on_axis = [&](int axis) { return absolute(number - R(T(axis + 1))) < R(T(0.5)); };
    for (int i = 0; i < 3; ++i) {
        R at = x[i], size = half[i];
        const R own = select(side < R(0), R(-1), R(1));
        if constexpr (sided) {
            const R more = select(absolute(covered - R(T(i + 1))) < R(T(0.5)), R(T(fitted::bridge / 2)), R(0));
            at = at - own * more, size = size + more;
        }
        sign[i] = select(at < R(0), R(-1), R(1));
        R along = absolute(at);
        if constexpr (sided) {
            const MaskOf<R> mine = on_axis(i);
            sign[i] = select(mine, own, sign[i]);
            along = select(mine, own * at, along);
            const MaskOf<R> passed = mine & (strict | (along < R(0)));
            beyond = beyond | passed;
            exit[i] = select(passed, own, R(0));
            through = select(passed, along - size, through);
        }
        q[i] = along - size;
        if constexpr (sided) {
            const MaskOf<R> reaches = (along_next & on_axis((i + 2) % 3)) | (along_last & on_axis((i + 1) % 3));
            q[i] = select(reaches, q[i] - R(T(fitted::bridge)), q[i]);
        }
        positive[i] = maximum(q[i], R(0));
    }
    const R outside = norm(positive);
    const MaskOf<R> is_outside = outside > R(0);
    const R inside = maximum(q.x, maximum(q.y, q.z));
    const R inverse = R(1) / select(is_outside, outside, R(1));
    Vec3<R> face{R(0), R(0), R(0)};
    MaskOf<R> taken = R(1) < R(0);
    for (int i = 0; i < 3; ++i) {
        const MaskOf<R> here = (q[i] >= inside) & !taken;
        face[i] = select(here, sign[i], R(0));
        taken = taken | here;
    }
    Vec3<R> out;
    for (int i = 0; i < 3; ++i) out[i] = inverse * positive[i] * sign[i];
    if constexpr (sided)
        return {select(is_outside, outside, select(beyond, through, inside)),
                select(is_outside, out, select(beyond, exit, face))};
    return {select(is_outside, outside, inside), select(is_outside, out, face)};
}

/// Cylinder along z: a box in the (radial, axial) half-plane.
template <class R, bool sided = false>
inline SurfacePoint<R> cylinder_point(const Vec3<R>& x, const R& radius, const R& half_length, const R& side = R(0)) {
    const R rho = square_root(x.x * x.x + x.y * x.y);
    const MaskOf<R> on_axis = rho <= R(0);
    const R inverse = R(1) / select(on_axis, R(1), rho);
    const Vec3<R> radial{select(on_axis, R(1), inverse * x.x), inverse * x.y, R(0)};
    // The third extent is far inside, so that the planar distance is never decided by it.
    const R end = absolute(side) - R(1);  // the second axis there
    const R of_end = select(end > R(1), select(side < R(0), -end, end), R(0));
    const SurfacePoint<R> planar =
        box_point<R, sided>(Vec3<R>{rho, x.z, R(0)}, Vec3<R>{radius, half_length, R(1e6f)}, of_end);
    return {planar.distance, {planar.normal.x * radial.x, planar.normal.x * radial.y, planar.normal.y}};
}

}  // namespace detail

namespace detail {
/// Every lane by itself.
template <class R>
inline SurfacePoint<R> mesh_point(const DistanceMesh& mesh, const Vec3<R>& x) {
    using T = ScalarOf<R>;
    constexpr int W = lane_width<R>;
    alignas(64) T values[4 * W];
    for (int l = 0; l < W; ++l) {
        const MeshPoint p =
            mesh_contact_distance(mesh, {double(lane(x.x, l)), double(lane(x.y, l)), double(lane(x.z, l))});
        values[l] = T(p.distance);
        values[W + l] = T(p.normal.x), values[2 * W + l] = T(p.normal.y), values[3 * W + l] = T(p.normal.z);
    }
    return {load<R>(values), {load<R>(values + W), load<R>(values + 2 * W), load<R>(values + 3 * W)}};
}
}  // namespace detail

/// Distance and normal of the point x to a shape that its dimensions describe (any but a mesh), in the shape's frame.
/// Lanes may differ in the dimensions.
template <class R>
inline SurfacePoint<R> primitive_point(ShapeKind kind, const Vec3<R>& size, const Vec3<R>& x) {
    switch (kind) {
        case ShapeKind::box:
            return detail::box_point(x, size);
        case ShapeKind::sphere:
            return detail::sphere_point(x, size.x);
        case ShapeKind::capsule: {
            const Vec3<R> offset{x.x, x.y, x.z - clamp(x.z, -size.y, size.y)};
            return detail::sphere_point(offset, size.x);
        }
        case ShapeKind::cylinder:
            return detail::cylinder_point(x, size.x, size.y);
        case ShapeKind::plane:
        case ShapeKind::mesh:
            break;
    }
    return {x.z, {R(0), R(0), R(1)}};
}

/// The number of a point's side, or more, where it is at the foot of a mesh that stands on something: the mesh's lower
/// face is no way out there. What is beyond the whole number says how far its wall leans back (foot_point).
inline constexpr int covered_mesh = 2;

/// Distance and normal of a point at the foot of a mesh, by `distance` of higher up: its walls go on down to what it
/// stands on as they lean, although edges of a smooth field are round, and although the lower face is nearer.
MeshPoint foot_point(const Shape& shape, const Vec3<double>& x, double side,
                     MeshPoint (*distance)(const DistanceMesh&, const Vec3<double>&));

/// Whether points remember the face of such a shape that they are on: box and cylinder (its ends), which may be thin.
inline bool has_sides(ShapeKind kind) { return kind == ShapeKind::box || kind == ShapeKind::cylinder; }

/// The same for a point on one side of a shape that has sides: 1, 2, 3 for the faces towards +x, +y, +z, negative for
/// the others; 0: none; strict sides are 4, 5, 6; bridged along the next axis 7, 8, 9, along the one after it 10, 11,
/// 12, along both 13, 14, 15; 16, 17, 18 are no sides but covered faces. Edges are rounded with a radius.
template <class R>
inline SurfacePoint<R> sided_point(ShapeKind kind, const Vec3<R>& size, const R& round, const Vec3<R>& x,
                                   const R& side) {
    const Vec3<R> inner{size.x - round, size.y - round, size.z - round};
    SurfacePoint<R> p = kind == ShapeKind::cylinder ? detail::cylinder_point<R, true>(x, inner.x, inner.y, side)
                                                    : detail::box_point<R, true>(x, inner, side);
    p.distance -= round;
    return p;
}

/// The side that a point at x (shape's frame) is on: where it is inside, or was pushed through, the one that it was on
/// before; otherwise the face that it is outside of by most, or, inside, nearest to.
int side_of(const Shape& shape, const Vec3<double>& x, int before);

/// Distance and normal of the point x, both in the shape's frame. Of a mesh, the distance is exact near its surface and
/// inside (mesh_contact_distance).
template <class R>
inline SurfacePoint<R> local_surface_point(const Shape& shape, const Vec3<R>& x) {
    if (shape.kind == ShapeKind::mesh) return detail::mesh_point(*shape.mesh, x);
    const Vec3<R> size{R(ScalarOf<R>(shape.size.x)), R(ScalarOf<R>(shape.size.y)), R(ScalarOf<R>(shape.size.z))};
    if (shape.round > 0 && has_sides(shape.kind))
        return sided_point(shape.kind, size, R(ScalarOf<R>(shape.round)), x, R(0));
    return primitive_point(shape.kind, size, x);
}

/// Distance and normal of the point x (world) to a shape at `pose`.
inline SurfacePoint<double> surface_point(const Shape& shape, const Pose<double>& pose, const Vec3<double>& x) {
    const Mat3<double> rotation = rotation_matrix(pose.rotation);
    const Vec3<double> local = transposed_times(rotation, x - pose.position);
    SurfacePoint<double> s;
    if (shape.kind == ShapeKind::mesh) {
        const MeshPoint p = mesh_surface_distance(*shape.mesh, local);
        s = {p.distance, p.normal};
    } else {
        s = local_surface_point(shape, local);
    }
    s.normal = rotation * s.normal;
    return s;
}
/// The same for a point on one side of it.
inline SurfacePoint<double> surface_point(const Shape& shape, const Pose<double>& pose, const Vec3<double>& x,
                                          double side) {
    const bool at_foot = shape.kind == ShapeKind::mesh && side >= covered_mesh;
    if (!at_foot && (side == 0 || !has_sides(shape.kind))) return surface_point(shape, pose, x);
    const Mat3<double> rotation = rotation_matrix(pose.rotation);
    const Vec3<double> local = transposed_times(rotation, x - pose.position);
    if (at_foot) {
        const MeshPoint p = foot_point(shape, local, side, mesh_surface_distance);
        return {p.distance, rotation * p.normal};
    }
    SurfacePoint<double> s = sided_point(shape.kind, shape.size, shape.round, local, side);
    s.normal = rotation * s.normal;
    return s;
}

}  // namespace palpate
