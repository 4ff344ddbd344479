#pragma once
// Rigid bodies: objects that forces move. Motions are 6-vectors: moved along xyz, turned about xyz through the centre
// of mass (left rotations, as in pose_spring.h).

#include <Eigen/Core>
#include <cmath>

#include "engine/contact/shape.h"
#include "engine/skin/solver_settings.h"

namespace palpate {

using Motion = Eigen::Matrix<double, 6, 1>;
using MotionMatrix = Eigen::Matrix<double, 6, 6>;

/// Object: mass and motion of a body.
struct RigidBody {
    double mass = 0.02;                           ///< [kg]
    Mat3<double> inertia = Mat3<double>::zero();  ///< about the centre of mass, object's frame [kg m^2]
    Vec3<double> mass_centre{0, 0, 0};            ///< object's frame [m]
    double size = 0.01;                           ///< largest distance of its surface from the centre of mass [m]
    double restitution = 0;                       ///< of contact with other objects
    double release = 0;                           ///< until then it stays where it is [s]
    Vec3<double> velocity{0, 0, 0};               ///< of the centre of mass [m/s]
    Vec3<double> angular_momentum{0, 0, 0};       ///< about the centre of mass, world [kg m^2/s]
    Vec3<double> contact_force{0, 0, 0};          ///< sum of all contacts in the last step, world [N]
    Vec3<double> contact_torque{0, 0, 0};         ///< about the centre of mass [N m]
    Vec3<double> acceleration{0, 0, 0};           ///< of the centre of mass in the last step [m/s^2]
    int iterations = 0;                           ///< of the last step
    bool converged = true, reset = false;         ///< how the last step ended
    int still_steps = 0;                          ///< steps for which all that it touches has not moved
    bool asleep = false;                          ///< at rest, far from fingers: skipped until something comes near
    bool gripped = false;  ///< in static equilibrium: skin had hold of it when the last step ended
    int shaken_steps = 0;  ///< for which its steps have more iterations: some had ended far from balance
};

/// Volume of a shape [m^3]; 0 for a plane.
double volume_of(const Shape& shape);
/// A solid body of even density.
RigidBody solid_body(const Shape& shape, double mass);

/// Pose of the centre of mass for an object's pose, and back.
inline Pose<double> centre_pose(const RigidBody& body, const Pose<double>& object) {
    return {transform(object, body.mass_centre), object.rotation};
}
inline Pose<double> object_pose(const RigidBody& body, const Pose<double>& centre) {
    return {centre.position - rotation_matrix(centre.rotation) * body.mass_centre, centre.rotation};
}

/// World angular velocity [rad/s].
inline Vec3<double> angular_velocity(const RigidBody& body, const Quaternion<double>& rotation) {
    const Mat3<double> R = rotation_matrix(rotation);
    const Vec3<double> L = transposed_times(R, body.angular_momentum);
    // Inverse of the inertia by its cofactors.
    const Mat3<double>& I = body.inertia;
    const Vec3<double> a = I.column(0), b = I.column(1), c = I.column(2);
    const double det = dot(a, cross(b, c));
    return R * ((1 / det) * Vec3<double>{dot(cross(b, c), L), dot(cross(c, a), L), dot(cross(a, b), L)});
}

inline double kinetic_energy(const RigidBody& body, const Quaternion<double>& rotation) {
    return 0.5 * (body.mass * dot(body.velocity, body.velocity) +
                  dot(angular_velocity(body, rotation), body.angular_momentum));
}

/// Rotation by the vector `turn` [rad], exactly.
inline Quaternion<double> rotation_by(const Vec3<double>& turn) {
    const double half = 0.5 * norm(turn), share = half > 1e-8 ? 0.5 * std::sin(half) / half : 0.5;
    return normalised(Quaternion<double>{std::cos(half), share * turn.x, share * turn.y, share * turn.z});
}

/// How far a body that nothing holds may fall in a step, beyond its speed [m].
double farthest_fall(const SolverSettings& solver);

/// Where the body would be at the end of the step without contact: gravity, and a free turn, which keeps its angular
/// momentum, and to the fourth order its energy.
Pose<double> free_flight(const RigidBody& body, const Pose<double>& centre, const Vec3<double>& gravity, double dt);

struct BodyTerms {
    double energy = 0;  ///< [J]
    Motion gradient = Motion::Zero();
    MotionMatrix curvature = MotionMatrix::Zero();
};

/// Inertia of implicit Euler: the pull towards `target`, E = m/2dt^2 |p - p^|^2 + 1/2dt^2 theta' I theta with
/// theta = 2 vec(conj(q^) q), the turn from the target in the object's frame.
inline BodyTerms body_inertia(const RigidBody& body, const Pose<double>& target, const Pose<double>& centre,
                              double dt) {
    const double rate2 = 1 / (dt * dt);
    BodyTerms t;
    const Vec3<double> d = centre.position - target.position;
    const Quaternion<double> e = conjugate(target.rotation) * centre.rotation;
    const double sign = e.w < 0 ? -1 : 1;
    const Vec3<double> v = e.vector(), theta = (2 * sign) * v, moment = body.inertia * theta;
    // Turning the body by omega changes theta by J omega, J = sign (w - skew(v)) R^'.
    const Mat3<double> J =
        sign * ((e.w * Mat3<double>::identity() - skew(v)) * transpose(rotation_matrix(target.rotation)));
    const Vec3<double> torque = rate2 * transposed_times(J, moment);
    const Mat3<double> turning = rate2 * (transpose(J) * (body.inertia * J));
    t.energy = 0.5 * rate2 * (body.mass * dot(d, d) + dot(theta, moment));
    for (int i = 0; i < 3; ++i) {
        t.gradient[i] = body.mass * rate2 * d[i];
        t.gradient[3 + i] = torque[i];
        t.curvature(i, i) = body.mass * rate2;
        for (int j = 0; j < 3; ++j) t.curvature(3 + i, 3 + j) = turning[i][j];
    }
    return t;
}

/// base moved by alpha times a motion.
inline Pose<double> moved(const Pose<double>& base, const Motion& motion, double alpha) {
    return {base.position + alpha * Vec3<double>{motion[0], motion[1], motion[2]},
            normalised(rotation_step(alpha * Vec3<double>{motion[3], motion[4], motion[5]}) * base.rotation)};
}

}  // namespace palpate
