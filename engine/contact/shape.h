#pragma once
// Virtual objects as signed distances with exact normals.

#include "engine/ecs/pose.h"

namespace palpate {

enum class ShapeKind { plane, box, sphere, capsule, cylinder };

/// Dimensions by kind, in the object's frame:
/// plane: none, surface z = 0, outside z > 0; box: half extents x, y, z; sphere: {radius};
/// capsule and cylinder: {radius, half length of the axis along z} (a capsule's caps come on top).
struct Shape {
    ShapeKind kind = ShapeKind::plane;
    Vec3<double> size{0, 0, 0};  ///< [m]
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
/// nearest face.
template <class R>
inline SurfacePoint<R> box_point(const Vec3<R>& x, const Vec3<R>& half) {
    Vec3<R> q, sign, positive;
    for (int i = 0; i < 3; ++i) {
        sign[i] = select(x[i] < R(0), R(-1), R(1));
        q[i] = absolute(x[i]) - half[i];
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
    return {select(is_outside, outside, inside), select(is_outside, out, face)};
}

/// Cylinder along z: a box in the (radial, axial) half-plane.
template <class R>
inline SurfacePoint<R> cylinder_point(const Vec3<R>& x, const R& radius, const R& half_length) {
    const R rho = square_root(x.x * x.x + x.y * x.y);
    const MaskOf<R> on_axis = rho <= R(0);
    const R inverse = R(1) / select(on_axis, R(1), rho);
    const Vec3<R> radial{select(on_axis, R(1), inverse * x.x), inverse * x.y, R(0)};
    // The third extent is far inside, so that the planar distance is never decided by it.
    const SurfacePoint<R> planar = box_point(Vec3<R>{rho, x.z, R(0)}, Vec3<R>{radius, half_length, R(1e6f)});
    return {planar.distance, {planar.normal.x * radial.x, planar.normal.x * radial.y, planar.normal.y}};
}

}  // namespace detail

/// Distance and normal of the point x, both in the shape's frame.
template <class R>
inline SurfacePoint<R> local_surface_point(const Shape& shape, const Vec3<R>& x) {
    const Vec3<R> size{R(ScalarOf<R>(shape.size.x)), R(ScalarOf<R>(shape.size.y)), R(ScalarOf<R>(shape.size.z))};
    switch (shape.kind) {
        case ShapeKind::plane:
            return {x.z, {R(0), R(0), R(1)}};
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
    }
    return {x.z, {R(0), R(0), R(1)}};
}

/// Distance and normal of the point x (world) to a shape at `pose`, the same for all lanes.
template <class R>
inline SurfacePoint<R> surface_point(const Shape& shape, const Pose<double>& pose, const Vec3<R>& x) {
    using T = ScalarOf<R>;
    const Mat3<double> Rd = rotation_matrix(pose.rotation);
    Mat3<R> rotation;
    for (int i = 0; i < 9; ++i) rotation.m[i / 3][i % 3] = R(T(Rd.m[i / 3][i % 3]));
    const Vec3<R> origin{R(T(pose.position.x)), R(T(pose.position.y)), R(T(pose.position.z))};
    SurfacePoint<R> s = local_surface_point(shape, transposed_times(rotation, x - origin));
    s.normal = rotation * s.normal;
    return s;
}

}  // namespace palpate
