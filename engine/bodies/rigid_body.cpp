#include "engine/bodies/rigid_body.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "engine/bodies/fitted.h"

namespace palpate {

double volume_of(const Shape& shape) {
    constexpr double pi = std::numbers::pi;
    const Vec3<double>& s = shape.size;
    switch (shape.kind) {
        case ShapeKind::plane:
            return 0;
        case ShapeKind::box:
            return 8 * s.x * s.y * s.z;
        case ShapeKind::sphere:
            return 4.0 / 3 * pi * s.x * s.x * s.x;
        case ShapeKind::capsule:
            return pi * s.x * s.x * (2 * s.y + 4.0 / 3 * s.x);
        case ShapeKind::cylinder:
            return pi * s.x * s.x * 2 * s.y;
        case ShapeKind::mesh:
            return shape.mesh->volume;
    }
    return 0;
}

RigidBody solid_body(const Shape& shape, double mass) {
    const Vec3<double>& s = shape.size;
    RigidBody body;
    body.mass = mass;
    Vec3<double> moments{0, 0, 0};
    switch (shape.kind) {
        case ShapeKind::plane:
            break;
        case ShapeKind::box:
            moments = (mass / 3) * Vec3<double>{s.y * s.y + s.z * s.z, s.x * s.x + s.z * s.z, s.x * s.x + s.y * s.y};
            break;
        case ShapeKind::sphere:
            moments = (0.4 * mass * s.x * s.x) * Vec3<double>{1, 1, 1};
            break;
        case ShapeKind::capsule: {
            // A cylinder with half a ball at each end, whose centre lies 3/8 of the radius out.
            const double caps = mass * 4 * s.x / (4 * s.x + 6 * s.y), tube = mass - caps, r2 = s.x * s.x;
            const double across = tube * (r2 / 4 + s.y * s.y / 3) + caps * (0.4 * r2 + s.y * s.y + 0.75 * s.x * s.y);
            moments = {across, across, tube * r2 / 2 + 0.4 * caps * r2};
            break;
        }
        case ShapeKind::cylinder: {
            const double across = mass * (s.x * s.x / 4 + s.y * s.y / 3);
            moments = {across, across, mass * s.x * s.x / 2};
            break;
        }
        case ShapeKind::mesh:
            body.inertia = (mass / shape.mesh->volume) * shape.mesh->inertia;
            body.mass_centre = shape.mesh->centroid;
            return body;
    }
    for (int i = 0; i < 3; ++i) body.inertia[i][i] = moments[i];
    return body;
}

namespace {

/// A body's rotation without torque, over a time in which it turns little: commutator-free Runge-Kutta of the fourth
/// order (Celledoni, Marthinsen and Owren 2003). What spins about an axis of its own turns exactly.
Quaternion<double> turned_freely(const RigidBody& body, const Quaternion<double>& start, double time) {
    auto spin = [&](const Quaternion<double>& q) { return time * angular_velocity(body, q); };
    const Vec3<double> k1 = spin(start);
    const Quaternion<double> half = rotation_by(0.5 * k1) * start;
    const Vec3<double> k2 = spin(half), k3 = spin(rotation_by(0.5 * k2) * start),
                       k4 = spin(rotation_by(k3 - 0.5 * k1) * half);
    const Vec3<double> middle = 2.0 * (k2 + k3), first = (1.0 / 12) * (3.0 * k1 + middle - k4),
                       second = (1.0 / 12) * (middle + 3.0 * k4 - k1);
    return normalised(rotation_by(second) * rotation_by(first) * start);
}

}  // namespace

double farthest_fall(const SolverSettings& solver) {
    return solver.inertia ? 20 * solver.dt * solver.dt : fitted::farthest_adrift;
}

Pose<double> free_flight(const RigidBody& body, const Pose<double>& centre, const Vec3<double>& gravity, double dt) {
    const double turn = dt * norm(angular_velocity(body, centre.rotation));
    const int parts = int(std::clamp(std::ceil(turn / fitted::turn_at_once), 1.0, double(fitted::most_turns)));
    Quaternion<double> rotation = centre.rotation;
    for (int i = 0; i < parts; ++i) rotation = turned_freely(body, rotation, dt / parts);
    return {centre.position + dt * body.velocity + (dt * dt) * gravity, rotation};
}

}  // namespace palpate
