#pragma once
// The bone's energy terms: springs from its pose to a target pose, and springs from its skin nodes.
// Rotations vary by small left rotations omega: R <- rotation_step(omega) R.

#include "engine/ecs/pose.h"

namespace palpate {

/// A spring of 6 dof that pulls a pose to a target. The virtual coupling, its damper and the bone's
/// inertia are three of these: implicit Euler makes each a quadratic pull towards a known pose.
template <class R>
struct PoseSpring {
    R linear_stiffness;   ///< [N/m]
    R angular_stiffness;  ///< [N m/rad]
    Pose<R> target;
};

template <class R>
struct PoseTerms {
    R energy;                               ///< [J]
    Vec3<R> force;                          ///< dE/dposition [N]
    Vec3<R> torque;                         ///< dE/domega [N m]
    R linear_curvature, angular_curvature;  ///< both times the identity: exact, and never negative
};

/// E = k/2 |p - p*|^2 + 4 kappa (1 - |e.w|), e = q conj(q*): for small angles kappa/2 angle^2; the
/// torque 2 kappa sin(angle/2) grows up to half a turn, so that a flipped target still pulls.
template <class R>
inline PoseTerms<R> pose_spring(const PoseSpring<R>& spring, const Pose<R>& pose) {
    const Vec3<R> d = pose.position - spring.target.position;
    const Quaternion<R> e = pose.rotation * conjugate(spring.target.rotation);
    const R w = absolute(e.w);
    const R half(ScalarOf<R>(0.5));
    PoseTerms<R> t;
    // 1 - w = |v|^2 / (1 + w) for a unit quaternion, without the cancellation.
    t.energy = half * spring.linear_stiffness * dot(d, d) +
               R(4) * spring.angular_stiffness * dot(e.vector(), e.vector()) / (R(1) + w);
    t.force = spring.linear_stiffness * d;
    t.torque = spring.angular_stiffness * shorter_twice_vector(e);
    t.linear_curvature = spring.linear_stiffness;
    t.angular_curvature = spring.angular_stiffness * w;
    return t;
}

template <class R>
struct BoneSpringTerms {
    R energy;                ///< [J]
    Vec3<R> node_gradient;   ///< dE/dx [N]; dE/dp is its negative
    Vec3<R> omega_gradient;  ///< dE/domega [N m]
    Mat3<R> omega_node;      ///< d2E/domega dx [N]; d2E/domega dp is its negative
    Mat3<R> omega_omega;     ///< d2E/domega2 [N m]
};

/// Stiff spring between a skin node x and its seat p + arm on the bone (arm = R r, world frame):
/// E = k/2 |x - p - arm|^2. `exact` adds the curvature of the rotating arm, which can be negative.
template <class R>
inline BoneSpringTerms<R> bone_spring(const Vec3<R>& x, const Vec3<R>& p, const Vec3<R>& arm, const R& k, bool exact) {
    const Vec3<R> d = x - p - arm;
    BoneSpringTerms<R> t;
    t.energy = R(ScalarOf<R>(0.5)) * k * dot(d, d);
    t.node_gradient = k * d;
    t.omega_gradient = k * cross(d, arm);
    t.omega_node = (-k) * skew(arm);
    t.omega_omega = k * (dot(arm, arm) * Mat3<R>::identity() - outer(arm, arm));
    if (exact) {
        const Mat3<R> da = outer(d, arm);
        t.omega_omega =
            t.omega_omega + k * (dot(d, arm) * Mat3<R>::identity()) - (R(ScalarOf<R>(0.5)) * k) * (da + transpose(da));
    }
    return t;
}

}  // namespace palpate
