#include "scenes/studies/random/watched_run.h"

#include <algorithm>
#include <cmath>
#include <cstdarg>
#include <cstdio>
#include <limits>

#include "engine/contact/fitted.h"
#include "engine/contact/shape.h"
#include "meshes/plain_numbers.h"
#include "scenes/studies/random/body_laws.h"
#include "scenes/studies/random/finger_laws.h"
#include "scenes/studies/random/sample_laws.h"

namespace palpate {

std::string law_text(const char* format, ...) {
    char buffer[300];
    va_list arguments;
    va_start(arguments, format);
    plain_vsnprintf(buffer, sizeof buffer, format, arguments);
    va_end(arguments);
    return buffer;
}

double rounding_of(const Watched& v, std::size_t finger) {
    if (!v.fingers[finger].skin->single_precision) return 1e-4;
    const double extent = 0.02, stiffness = v.s.world.couplings.find(v.s.fingers[finger])->stiffness;
    return 2e-3 + 2 * double(std::numeric_limits<float>::epsilon()) * extent * stiffness;
}

bool is_in_island(const World& w, std::size_t finger) {
    const auto& near = w.finger_pairs.near;
    return w.bodies.size() > 0 || std::any_of(near.begin(), near.end(), [&](const FingerPair& p) {
               return p.a == int(finger) || p.b == int(finger);
           });
}

namespace {

/// Far beyond what hands of random scenes can do, whether a step has converged or not [m/s, N].
constexpr double absurd_speed = 100, absurd_force = 1e7;

double mechanical_energy(const World& w, const VirtualObject& shape) {
    const RigidBody& b = w.bodies[shape.body];
    const Pose<double> centre = centre_pose(b, shape.pose);
    const Vec3<double> turn = angular_velocity(b, shape.pose.rotation);
    return 0.5 * b.mass * dot(b.velocity, b.velocity) + 0.5 * dot(turn, b.angular_momentum) -
           b.mass * dot(w.gravity, centre.position);
}

/// A solve that says it has converged has no sample inside a rigid object beyond the tolerance.
void check_penetration(const Watched& v, Findings& found) {
    const World& w = v.s.world;
    const double allowed = 3 * w.solver.contact_tolerance + 2e-6;
    for (std::size_t i = 0; i < v.fingers.size(); ++i) {
        const FingerState& f = v.fingers[i];
        if (!f.status.converged || f.status.reset) continue;
        for (int node : f.skin->mesh.pad_nodes)
            for (const VirtualObject& o : w.shapes) {
                if (o.stiffness > 0 || o.soft >= 0) continue;  // tissue: check_tissue
                const double depth = -surface_point(o.shape, o.pose, f.position[std::size_t(node)]).distance;
                if (depth > allowed)
                    found.add(
                        "converged means outside",
                        law_text("%.4f s: %s is %.4f mm inside %s, and says it has converged (%.4f mm)", w.time,
                                 f.skin->name.c_str(), 1e3 * depth, o.name.c_str(), 1e3 * f.status.penetration_m));
            }
    }
}

/// A solve that says it has converged reports nothing beyond its tolerances. (What is measured from outside: the two
/// laws around this one.)
void check_status(const Watched& v, Findings& found) {
    const SolverSettings& solver = v.s.world.solver;
    for (std::size_t i = 0; i < v.fingers.size(); ++i) {
        const FingerState& f = v.fingers[i];
        const SkinStatus& s = f.status;
        if (!s.converged || s.reset) continue;
        const double pull = v.s.world.couplings.find(v.s.fingers[i])->force_N;
        const double forces = std::max({s.contact_force_N, norm(f.reaction), pull});
        const double rounding = std::max(rounding_of(v, i), is_in_island(v.s.world, i) ? fitted::own_rounding : 0);
        const double residual = std::max(1e-3, 3 * solver.tolerance) * forces + rounding;
        const double violation = 1.01 * solver.limit_tolerance + 1e-6;
        const double penetration = 1.01 * solver.contact_tolerance + 1e-8;
        if (s.residual_N > residual || s.limit_violation > violation || s.penetration_m > penetration ||
            s.wrong_sides > 0)
            found.add(
                "converged means within tolerances",
                law_text("%.4f s: %s: residual %.3g of %.3g N, limits exceeded by %.3g, %.3g mm deep, %d wrong sides",
                         v.s.world.time, f.skin->name.c_str(), s.residual_N, forces, s.limit_violation,
                         1e3 * s.penetration_m, s.wrong_sides));
    }
}

/// What is reported of contact is what acted: mass x acceleration = contact + bone's reaction, per finger.
void check_finger_balance(const Watched& v, Findings& found) {
    const World& w = v.s.world;
    for (std::size_t i = 0; i < v.fingers.size(); ++i) {
        const FingerState& f = v.fingers[i];
        if (!f.status.converged || f.status.reset || !f.solved || v.before.empty() || !v.before[i].solved) continue;
        if (v.before[i].velocity.empty()) continue;  // accelerations take three steps
        // Where an overlap was undone, velocities are less than positions say (end_slots).
        if (!v.before[i].status.converged && v.before[i].status.penetration_m > 1e-6) continue;
        const Vec3<double> off = f.momentum_rate(v.before[i], w.solver.dt) - f.contact - f.reaction;
        const double scale = norm(f.contact) + norm(f.reaction) + f.normal_force;
        // What a solve leaves over at each node, within its tolerance (check_status), may be along one direction at
        // all.
        const double left = std::sqrt(double(f.mass.size())) * f.status.residual_N;
        if (norm(off) > 2e-2 * scale + std::max({2e-3, rounding_of(v, i), left}))
            found.add("reported forces are those that act",
                      law_text("%.4f s: %s: contact and bone leave %.4f of %.4f N over", w.time, f.skin->name.c_str(),
                               norm(off), scale));
    }
}

/// Two fingers that press on each other do so with opposite forces and torques, in every step, converged or not.
void check_finger_pairs(const Watched& v, Findings& found) {
    const World& w = v.s.world;
    if (w.finger_pairs.near.empty()) return;
    Vec3<double> force{0, 0, 0}, torque{0, 0, 0};
    double size = 0;
    for (const FingerPair& p : w.finger_pairs.near)
        for (const bool of_b : {false, true}) {
            const ContactSurface& c = w.contact_surfaces[std::size_t(of_b ? p.b : p.a)];
            for (const ObjectContact& o : c.objects)
                if (o.finger == (of_b ? p.a : p.b)) force += o.force, size += norm(o.force);
        }
    if (v.s.scene.spec.objects.empty())  // then all that a finger feels is others
        for (const ContactSurface& c : w.contact_surfaces)
            for (std::size_t k = 0; k < c.force.size(); ++k)
                torque += cross(transform(c.bone, c.position[k]) - w.finger_pairs.near[0].pose.position, c.force[k]);
    const double far = 0.1;  // across all fingers [m]
    if (norm(force) > 1e-6 * size + 1e-7 || norm(torque) > far * (1e-6 * size + 1e-7))
        found.add("action is reaction between fingers", law_text("%.4f s: %.3g N and %.3g Nmm of %.4f N are left over",
                                                                 w.time, norm(force), 1e3 * norm(torque), size));
}

/// Tissue stays finite, and presses on fingers with what they press on it with, in every step, converged or not.
void check_tissue(const Watched& v, Findings& found) {
    const World& w = v.s.world;
    for (const SoftObject& o : w.soft.all) {
        const std::string& name = w.shapes[std::size_t(o.object)].name;
        for (const Point& p : soft_positions(w, o))
            if (!std::isfinite(p[0] + p[1] + p[2]))
                found.add("everything stays finite", law_text("%.4f s: %s", w.time, name.c_str()));
        Vec3<double> left = o.surface.total;
        double size = norm(left);
        for (const ObjectContact& c : o.surface.objects)
            if (c.object >= 0) left -= c.force;
        for (const ContactSurface& finger : w.contact_surfaces)
            for (const ObjectContact& c : finger.objects)
                if (c.object == o.object) left += c.force, size += norm(c.force);
        if (norm(left) > 1e-6 * size + 1e-7)
            found.add("action is reaction on tissue",
                      law_text("%.4f s: %.3g N of %.4f N on %s are left over", w.time, norm(left), size, name.c_str()));
    }
}

/// Mass x (acceleration - gravity) of a body is what its contacts report, and what fingers report of it.
void check_body_balance(const Watched& v, Findings& found) {
    const World& w = v.s.world;
    // In single precision, rounding of a grip's forces moves a light body.
    const double floor = w.chunks.floats.empty() ? 1e-4 : 2e-3;
    for (std::size_t o = 0; o < w.shapes.size(); ++o) {
        const VirtualObject& shape = w.shapes[o];
        if (shape.body < 0) continue;
        const RigidBody& b = w.bodies[shape.body];
        if (!b.converged || b.reset || b.asleep) continue;
        const Vec3<double> needed = b.mass * (b.acceleration - w.gravity);
        const double weight = b.mass * norm(w.gravity), scale = weight + norm(b.contact_force);
        if (norm(needed - b.contact_force) > 2e-2 * scale + floor)
            found.add("bodies move as their contacts say",
                      law_text("%.4f s: %s: %.4f N of %.4f N unexplained", w.time, shape.name.c_str(),
                               norm(needed - b.contact_force), scale));
    }
}

/// No object's surface lies inside the tissue behind a node of the skin: it would have passed through. Between nodes
/// faces are flat: what is round, or has an edge, lies inside them by a part of their size.
void check_tunnelling(const Watched& v, Findings& found) {
    const World& w = v.s.world;
    constexpr double entered = 1e-3;  // through skin that rides on its bone, which does not touch: the run says so [m]
    for (std::size_t i = 0; i < v.fingers.size(); ++i) {
        const FingerState& f = v.fingers[i];
        if (!f.status.converged || f.status.reset) continue;
        if (fixed_skin_depth(v.s.fixed_skins[i], f.bone, w.shapes) > entered) continue;
        // A fifth more than the status allows (crossed_skin.h), which looks at the pad's faces alone.
        const double allowed = 0.3 * f.longest_edge();
        for (const VirtualObject& o : w.shapes) {
            if (o.stiffness > 0 || o.soft >= 0) continue;  // tissue: check_tissue
            const double depth = f.depth_under_skin(o.shape, o.pose);
            if (depth > allowed)
                found.add("nothing passes through skin", law_text("%.4f s: %s is %.2f mm under the skin of %s", w.time,
                                                                  o.name.c_str(), 1e3 * depth, f.skin->name.c_str()));
        }
    }
}

/// Where all hands hold still, bodies gain no energy.
void check_energy(Watched& v, Findings& found) {
    const World& w = v.s.world;
    double now = 0, first = 0, size = 0;
    for (std::size_t o = 0, b = 0; o < w.shapes.size(); ++o) {
        if (w.shapes[o].body < 0) continue;
        now += mechanical_energy(w, w.shapes[o]);
        // A thousandth of it, before and after (brake_gain.cpp).
        v.energy_slack += 2e-3 * kinetic_energy(w.bodies[w.shapes[o].body], w.shapes[o].pose.rotation);
        first += v.first_energy[b++];
        size += w.bodies[w.shapes[o].body].mass * norm(w.gravity) * 0.01;
    }
    // What has passed through skin is pressed on from inside, and away: steps say so (wrong_sides).
    for (const FingerState& f : v.fingers) v.passed_through |= f.status.wrong_sides > 0;
    if (v.passed_through) return;
    if (now > first + 0.02 * size + lifted_by_overlaps(v) + v.energy_slack)
        found.add("no energy is gained",
                  law_text("%.4f s: bodies have %.5g J more than at the start, %.2g mm of height", w.time, now - first,
                           10 * (now - first) / size));
}

bool holds_still(const Scene& scene) {
    auto still = [](const std::vector<Keyframe>& track) { return track.size() < 2; };
    for (const FingerMotion& m : scene.finger_motions)
        if (!still(m.keyframes) || m.followed_finger >= 0) return false;
    for (const auto& m : scene.object_motions)
        if (!still(m)) return false;
    return still(scene.hand);
}

}  // namespace

Trace watch(Simulation& s, Findings* found, RunWriter* recorder) {
    Trace trace;
    Watched v{s, {}, {}, {}, {}, {}, {}, {}, {}};
    const bool still = holds_still(s.scene);
    for (const VirtualObject& shape : s.world.shapes)
        if (shape.body >= 0) v.first_energy.push_back(mechanical_energy(s.world, shape));
    if (found) see_overlaps(v);
    const auto steps = std::max(1L, std::lround(s.scene.duration / s.world.solver.dt));
    for (long k = 0; k < steps; ++k) {
        const StepInputs inputs = next_inputs(s);
        advance(s, inputs);
        if (recorder) recorder->record(inputs, s);
        v.before = std::move(v.fingers);
        v.fingers = finger_states(s, v.before);
        trace.fingers_near |= !s.world.finger_pairs.near.empty();
        std::vector<double> forces;
        for (const FingerState& f : v.fingers) {
            forces.push_back(f.normal_force);
            trace.all_converged &= f.status.converged && !f.status.reset;
            trace.iterations += f.status.newton_iterations;
            if (found && !f.finite())
                found->add("everything stays finite", law_text("%.4f s: %s", s.world.time, f.skin->name.c_str()));
        }
        for (const RigidBody& b : s.world.bodies) {
            trace.all_converged &= b.converged && !b.reset;
            if (found && !(norm(b.velocity) < absurd_speed && norm(b.contact_force) < absurd_force))
                found->add("nothing is thrown away",
                           law_text("%.4f s: a body of %.3g g at %.3g m/s, under %.3g N", s.world.time, 1e3 * b.mass,
                                    norm(b.velocity), norm(b.contact_force)));
        }
        trace.force.push_back(std::move(forces));
        trace.hashes.push_back(outcome_of(s).hashes);
        see_bodies(v);
        if (!found) continue;
        check_penetration(v, *found);
        check_status(v, *found);
        check_finger_balance(v, *found);
        check_body_balance(v, *found);
        check_tissue(v, *found);
        check_finger_pairs(v, *found);
        check_tunnelling(v, *found);
        check_coupling(v, *found);
        check_free_bones(v, *found);
        check_friction(v, *found);
        check_flight(v, *found);
        check_motion(v, *found);
        see_overlaps(v);
        check_overlaps(v, *found);
        if (still && !v.first_energy.empty()) check_energy(v, *found);
        check_slips(v, *found);
        check_leaps(v, *found);
    }
    if (found) check_drops(s, *found);
    trace.overlapped = lifted_by_overlaps(v) > 0;
    if (recorder) recorder->finish();
    for (const VirtualObject& shape : s.world.shapes)
        if (shape.body >= 0) trace.bodies.push_back(shape.pose.position);
    return trace;
}

}  // namespace palpate
