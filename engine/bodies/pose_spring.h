#pragma once
// The bone: springs from its pose to a target pose, and how its pose carries the nodes that are fixed in it.
// Rotations vary by small left rotations omega: R <- rotation_step(omega) R.

#include "engine/math/pose.h"

namespace palpate {

/// A spring of 6 dof that pulls a pose to a target. The virtual coupling, its damper and the bone's
/// inertia are three of these: implicit Euler makes each a quadratic pull towards a known pose.
template <class R>
struct PoseSpring {
    R linear_stiffness;   ///< [N/m]
    R angular_stiffness;  ///< [N m/rad]
    Pose<R> target;
    R reach = R(ScalarOf<R>(1e30));      ///< it pulls no harder than over this distance [m]
    R half_turn = R(ScalarOf<R>(1e30));  ///< and turns no harder than over an angle whose half has this sine
};

template <class R>
struct PoseTerms {
    R energy;                               ///< [J]
    Vec3<R> force;                          ///< dE/dposition [N]
    Vec3<R> torque;                         ///< dE/domega [N m]
    R linear_curvature, angular_curvature;  ///< both times the identity: never negative, exact within the reach; beyond
                                            ///< it those of the parabola that touches E and lies above it
};

/// E = k/2 |p - p*|^2 + 4 kappa (1 - |e.w|), e = q conj(q*): for small angles kappa/2 angle^2; the
/// torque 2 kappa sin(angle/2) grows up to half a turn, so that a flipped target still pulls. Beyond the reach r the
/// force stays k r: E = k r (|p - p*| - r/2) (Huber 1964), and turns likewise, linear in the sine s of half the angle.
template <class R>
inline PoseTerms<R> pose_spring(const PoseSpring<R>& spring, const Pose<R>& pose) {
    const Vec3<R> d = pose.position - spring.target.position;
    const Quaternion<R> e = pose.rotation * conjugate(spring.target.rotation);
    const R w = absolute(e.w);
    const R half(ScalarOf<R>(0.5));
    const R distance = norm(d), sine = norm(e.vector());
    const MaskOf<R> far = distance > spring.reach, turned = sine > spring.half_turn;
    PoseTerms<R> t;
    // 1 - w = |v|^2 / (1 + w) for a unit quaternion, without the cancellation.
    R turning = R(4) * spring.angular_stiffness * dot(e.vector(), e.vector()) / (R(1) + w);
    R pulling = half * spring.linear_stiffness * dot(d, d);
    R k = spring.linear_stiffness, kappa = spring.angular_stiffness;
    if (any(far)) {
        pulling = select(far, k * spring.reach * (distance - half * spring.reach), pulling);
        k = select(far, k * (spring.reach / distance), k);
    }
    if (any(turned)) {
        const R s = spring.half_turn, c = square_root(maximum(R(0), R(1) - s * s));
        // Slopes of both agree where they meet: dE/ds = 4 kappa s / c there.
        const R floor = R(ScalarOf<R>(1e-3)), slope = s / maximum(c, floor);
        turning = select(turned, R(4) * kappa * (s * s / (R(1) + c) + slope * (sine - s)), turning);
        kappa = select(turned, kappa * slope * (w / sine), kappa);
    }
    t.energy = pulling + turning;
    t.force = k * d;
    t.torque = kappa * shorter_twice_vector(e);
    t.linear_curvature = k;
    t.angular_curvature = kappa * w;
    return t;
}

/// How the bone's 6 unknowns see a node that is fixed in it at p + arm (arm = R r, world frame):
/// dx = dp + omega x arm.
template <class R>
inline Vec3<R> torque_of(const Vec3<R>& arm, const Vec3<R>& gradient) {
    return cross(arm, gradient);
}

/// Curvature of such a node's gradient along omega, from the second order of the rotation:
/// g . (omega x (omega x arm)) / 2 = omega^T H omega / 2. Not definite.
template <class R>
inline Mat3<R> turning_curvature(const Vec3<R>& arm, const Vec3<R>& gradient) {
    const Mat3<R> ag = outer(arm, gradient);
    return R(ScalarOf<R>(0.5)) * (ag + transpose(ag)) - dot(arm, gradient) * Mat3<R>::identity();
}

}  // namespace palpate
