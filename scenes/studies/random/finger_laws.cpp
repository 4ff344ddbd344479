#include "scenes/studies/random/finger_laws.h"

#include <algorithm>
#include <cmath>

namespace palpate {

namespace {

/// Sine of half the angle between two rotations.
double half_turn(const Quaternion<double>& a, const Quaternion<double>& b) { return norm((a * conjugate(b)).vector()); }

/// What the solve may leave of a finger's forces, of those that act (check_status asks for the same) [N].
double left_over(const Watched& v, std::size_t i, double forces) {
    const FingerState& f = v.fingers[i];
    return std::max(1e-3, 3 * v.s.world.solver.tolerance) * forces + rounding_of(v, i) +
           (is_in_island(v.s.world, i) ? 1e-3 : 0) + std::sqrt(double(f.mass.size())) * f.status.residual_N;
}

/// Whether a finger's motion is what its forces made of it for three steps, from which accelerations are known.
bool accelerates(const Watched& v, std::size_t i) {
    const FingerState& f = v.fingers[i];
    if (!f.status.converged || f.status.reset || v.before.empty()) return false;
    const FingerState& b = v.before[i];
    if (b.velocity.empty() || b.status.reset) return false;
    // Where an overlap was undone, velocities are less than positions say (end_slots).
    return f.solved && b.solved && (b.status.converged || b.status.penetration_m < 1e-5);
}

}  // namespace

void check_coupling(const Watched& v, Findings& found) {
    const World& w = v.s.world;
    const double dt = w.solver.dt;
    for (std::size_t i = 0; i < v.fingers.size(); ++i) {
        if (!accelerates(v, i)) continue;
        const FingerState &f = v.fingers[i], &b = v.before[i];
        const Coupling& c = *w.couplings.find(v.s.fingers[i]);
        const Vec3<double> inertia = (c.bone_mass / dt) * (f.bone_velocity - b.bone_velocity);
        const Vec3<double> damper =
            (c.damping / dt) * (c.target.position - c.last_target.position - dt * f.bone_velocity);
        const double drawn = norm(inertia + f.reaction - damper);
        const double forces = norm(inertia) + norm(f.reaction) + norm(damper) + f.normal_force;
        const double left = left_over(v, i, forces);
        if (drawn > c.max_force + left)
            found.add("a coupling draws no harder than it may",
                      law_text("%.4f s: %s is drawn by %.4g N, and may be by %.4g N", w.time, f.skin->name.c_str(),
                               drawn, c.max_force));
        // Springs that turn give twice the sine of half the angle (pose_spring.h).
        auto twice = [](const Quaternion<double>& q) { return (q.w < 0 ? -2.0 : 2.0) * q.vector(); };
        const Quaternion<double> coasting = b.bone_turn * b.bone.rotation;
        const Quaternion<double> carried = c.target.rotation * conjugate(c.last_target.rotation) * b.bone.rotation;
        const Vec3<double> turning = (c.bone_inertia / (dt * dt)) * twice(f.bone.rotation * conjugate(coasting));
        const Vec3<double> braking = (c.angular_damping / dt) * twice(carried * conjugate(f.bone.rotation));
        const double turned = norm(turning + f.reaction_torque - braking);
        const double torques = norm(turning) + norm(f.reaction_torque) + norm(braking);
        const double extent = 0.02;  // of a finger: torques are left over as forces are [m]
        if (turned > c.max_torque + std::max(1e-3, 3 * w.solver.tolerance) * torques + extent * left)
            found.add("a coupling turns no harder than it may",
                      law_text("%.4f s: %s is turned by %.4g Nm, and may be by %.4g Nm", w.time, f.skin->name.c_str(),
                               turned, c.max_torque));
    }
}

void check_free_bones(Watched& v, Findings& found) {
    const World& w = v.s.world;
    v.free_bones.resize(v.fingers.size());
    for (std::size_t i = 0; i < v.fingers.size(); ++i) {
        const FingerState& f = v.fingers[i];
        const Coupling& c = *w.couplings.find(v.s.fingers[i]);
        FreeBone& free = v.free_bones[i];
        const double away = norm(f.bone.position - c.target.position),
                     turned = half_turn(f.bone.rotation, c.target.rotation);
        const bool still = norm(c.target.position - c.last_target.position) < 1e-12 &&
                           half_turn(c.target.rotation, c.last_target.rotation) < 1e-9;
        if (!still || f.normal_force > 0 || !f.status.converged || f.status.reset) {
            free.since = -1;
            continue;
        }
        if (free.since < 0) free = {w.time, away, turned};
        // Drawn as hard as it may be against its damper, then twenty times what it takes to swing out or creep: e^-20
        // of it is left. Doubled, for it may have begun the other way.
        double mass = c.bone_mass;
        for (const double m : f.mass) mass += m;
        auto settles = [&](double inertia, double damping, double stiffness, double travel, double most) {
            return 2 * (travel * damping / most + 20 * std::max(2 * inertia / damping, damping / stiffness)) +
                   10 * w.solver.dt;
        };
        constexpr double far = 0.015;  // tissue around the bone [m]
        const double time = w.time - free.since;
        const double moved_by = settles(mass, c.damping, c.stiffness, free.distance, c.max_force),
                     turned_by = settles(mass * far * far, c.angular_damping, c.angular_stiffness, 2 * free.half_turn,
                                         c.max_torque);
        const double left = left_over(v, i, c.stiffness * away);
        if (time > moved_by && away > 1e-6 + 0.01 * free.distance + left / c.stiffness)
            found.add("a bone that nothing holds comes to its tracked pose",
                      law_text("%.4f s: %s is %.4g mm away, %.3g s after nothing held it (%.4g mm then)", w.time,
                               f.skin->name.c_str(), 1e3 * away, time, 1e3 * free.distance));
        if (time > turned_by && turned > 1e-4 + 0.01 * free.half_turn + far * left / c.angular_stiffness)
            found.add("a bone that nothing holds turns to its tracked pose",
                      law_text("%.4f s: %s is turned by %.4g, %.3g s after nothing held it (%.4g then)", w.time,
                               f.skin->name.c_str(), 2 * turned, time, 2 * free.half_turn));
    }
}

double friction_between(const Simulation& s, std::size_t finger, std::size_t object) {
    for (const FingerFriction& own : s.scene.spec.finger_frictions)
        if (own.finger == int(finger) && own.object == int(object)) return own.friction;
    return s.world.shapes[object].friction;
}

void check_friction(const Watched& v, Findings& found) {
    const World& w = v.s.world;
    for (std::size_t i = 0; i < v.fingers.size(); ++i) {
        const FingerState& f = v.fingers[i];
        if (!f.status.converged || f.status.reset) continue;
        // Friction and its limit may still change by what a solve leaves pending: a share of all that acts.
        const double pull = w.couplings.find(v.s.fingers[i])->force_N,
                     pending = 2 * w.solver.multiplier_tolerance * std::max(f.normal_force, pull);
        for (const ObjectContact& o : f.objects) {
            if (o.object < 0) continue;
            const double friction = friction_between(v.s, i, std::size_t(o.object));
            // What leaves an object keeps, in that step, the friction of what it pressed with before.
            double pressed = o.normal_force;
            if (!v.before.empty())
                for (const ObjectContact& b : v.before[i].objects)
                    if (b.object == o.object) pressed = std::max(pressed, b.normal_force);
            const double most = friction * pressed;
            if (o.friction_force > most + (1 + friction) * (left_over(v, i, f.normal_force) + pending))
                found.add(
                    "friction keeps to Coulomb's law",
                    law_text("%.4f s: %s rubs on %s with %.4g N, and may with %.4g N", w.time, f.skin->name.c_str(),
                             w.shapes[std::size_t(o.object)].name.c_str(), o.friction_force, most));
        }
    }
}

bool sticks(const ObjectContact& o) {
    return o.normal_force > 0.1 && o.friction_available > 0 && o.friction_force < 0.7 * o.friction_available;
}

bool stuck_before(const FingerState& before, const ObjectContact& now) {
    return std::any_of(before.objects.begin(), before.objects.end(), [&](const ObjectContact& b) {
        return b.object == now.object && sticks(b) && b.normal_force > 0.95 * now.normal_force &&
               now.normal_force > 0.95 * b.normal_force;
    });
}

}  // namespace palpate
