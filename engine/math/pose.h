#pragma once
// Rigid poses over any lane type: a position and a unit quaternion.

#include "engine/math/linear_algebra.h"

namespace palpate {

/// Unit quaternion (w, v): rotation by 2 acos(w) about v.
template <class R>
struct Quaternion {
    R w, x, y, z;
    static Quaternion identity() { return {R(1), R(0), R(0), R(0)}; }
    Vec3<R> vector() const { return {x, y, z}; }

    friend Quaternion operator*(const Quaternion& a, const Quaternion& b) {
        return {a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z, a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y,
                a.w * b.y - a.x * b.z + a.y * b.w + a.z * b.x, a.w * b.z + a.x * b.y - a.y * b.x + a.z * b.w};
    }
};

template <class R>
inline Quaternion<R> conjugate(const Quaternion<R>& q) {
    return {q.w, -q.x, -q.y, -q.z};
}

template <class R>
inline Quaternion<R> normalised(const Quaternion<R>& q) {
    const R s = R(1) / square_root(q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z);
    return {s * q.w, s * q.x, s * q.y, s * q.z};
}

template <class R>
inline Mat3<R> rotation_matrix(const Quaternion<R>& q) {
    const R one(1), two(2);
    const R xx = q.x * q.x, yy = q.y * q.y, zz = q.z * q.z;
    const R xy = q.x * q.y, xz = q.x * q.z, yz = q.y * q.z;
    const R wx = q.w * q.x, wy = q.w * q.y, wz = q.w * q.z;
    return {{{one - two * (yy + zz), two * (xy - wz), two * (xz + wy)},
             {two * (xy + wz), one - two * (xx + zz), two * (yz - wx)},
             {two * (xz - wy), two * (yz + wx), one - two * (xx + yy)}}};
}

/// Rotation by the vector `omega` [rad], by the Cayley map: exact to third order, and exactly
/// orthogonal for any size, so that a Newton step of any length stays a rotation.
template <class R>
inline Quaternion<R> rotation_step(const Vec3<R>& omega) {
    const R half(0.5);
    return normalised(Quaternion<R>{R(1), half * omega.x, half * omega.y, half * omega.z});
}

/// Angular velocity-like vector 2 v of the shorter rotation (sign of w chosen positive).
template <class R>
inline Vec3<R> shorter_twice_vector(const Quaternion<R>& q) {
    const R s = select(q.w < R(0), R(-2), R(2));
    return {s * q.x, s * q.y, s * q.z};
}

template <class R>
struct Pose {
    Vec3<R> position;        ///< [m]
    Quaternion<R> rotation;  ///< unit
    static Pose identity() { return {{R(0), R(0), R(0)}, Quaternion<R>::identity()}; }
};

template <class R>
inline Vec3<R> transform(const Pose<R>& pose, const Vec3<R>& local) {
    return pose.position + rotation_matrix(pose.rotation) * local;
}
template <class R>
inline Vec3<R> inverse_transform(const Pose<R>& pose, const Vec3<R>& world) {
    return transposed_times(rotation_matrix(pose.rotation), world - pose.position);
}
template <class R>
inline Pose<R> compose(const Pose<R>& a, const Pose<R>& b) {
    return {transform(a, b.position), normalised(a.rotation * b.rotation)};
}

}  // namespace palpate
