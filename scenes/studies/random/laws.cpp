#include "scenes/studies/random/laws.h"

#include <algorithm>
#include <cmath>
#include <cstdarg>
#include <numbers>

#include "engine/contact/shape.h"
#include "scenes/recording/run_file.h"
#include "scenes/run/simulation.h"
#include "scenes/studies/random/finger_state.h"

namespace palpate {

namespace {

[[gnu::format(printf, 1, 2)]] std::string text(const char* format, ...) {
    char buffer[300];
    va_list arguments;
    va_start(arguments, format);
    std::vsnprintf(buffer, sizeof buffer, format, arguments);
    va_end(arguments);
    return buffer;
}

/// What has been found in one run: the first of each law.
struct Findings {
    std::vector<Violation> all;
    void add(const std::string& law, const std::string& found) {
        for (const Violation& v : all)
            if (v.law == law) return;
        all.push_back({law, found});
    }
};

/// A scene's world seen step by step.
struct Watched {
    const Simulation& s;
    std::vector<FingerState> fingers;  ///< now
    std::vector<FingerState> before;
    std::vector<double> first_energy;  ///< of each body [J]
};

double mechanical_energy(const World& w, const RigidShape& shape) {
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
            for (const RigidShape& o : w.shapes) {
                if (o.stiffness > 0) continue;
                const double depth = -surface_point(o.shape, o.pose, f.position[std::size_t(node)]).distance;
                if (depth > allowed)
                    found.add("converged means outside",
                              text("%.4f s: %s is %.4f mm inside %s, and says it has converged (%.4f mm)", w.time,
                                   f.skin->name.c_str(), 1e3 * depth, o.name.c_str(), 1e3 * f.status.penetration_m));
            }
    }
}

/// What is reported of contact is what acted: mass x acceleration = contact + bone's reaction, per finger.
void check_finger_balance(const Watched& v, Findings& found) {
    const World& w = v.s.world;
    for (std::size_t i = 0; i < v.fingers.size(); ++i) {
        const FingerState& f = v.fingers[i];
        if (!f.status.converged || f.status.reset || !f.solved || v.before.empty() || !v.before[i].solved) continue;
        if (v.before[i].velocity.empty()) continue;  // accelerations take three steps
        const Vec3<double> off = f.momentum_rate(v.before[i], w.solver.dt) - f.contact - f.reaction;
        const double scale = norm(f.contact) + norm(f.reaction) + f.normal_force;
        if (norm(off) > 2e-2 * scale + 2e-3)
            found.add("reported forces are those that act",
                      text("%.4f s: %s: contact and bone leave %.4f of %.4f N over", w.time, f.skin->name.c_str(),
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
        found.add("action is reaction between fingers", text("%.4f s: %.3g N and %.3g Nmm of %.4f N are left over",
                                                             w.time, norm(force), 1e3 * norm(torque), size));
}

/// Mass x (acceleration - gravity) of a body is what its contacts report, and what fingers report of it.
void check_body_balance(const Watched& v, Findings& found) {
    const World& w = v.s.world;
    // In single precision, rounding of a grip's forces moves a light body.
    const double floor = w.chunks.floats.empty() ? 1e-4 : 2e-3;
    for (std::size_t o = 0; o < w.shapes.size(); ++o) {
        const RigidShape& shape = w.shapes[o];
        if (shape.body < 0) continue;
        const RigidBody& b = w.bodies[shape.body];
        if (!b.converged || b.reset || b.asleep) continue;
        const Vec3<double> needed = b.mass * (b.acceleration - w.gravity);
        const double weight = b.mass * norm(w.gravity), scale = weight + norm(b.contact_force);
        if (norm(needed - b.contact_force) > 2e-2 * scale + floor)
            found.add("bodies move as their contacts say",
                      text("%.4f s: %s: %.4f N of %.4f N unexplained", w.time, shape.name.c_str(),
                           norm(needed - b.contact_force), scale));
    }
}

/// Half the width of an object that may fit between samples [m]: of a box, the middle one of the three.
double half_width(const Shape& shape) {
    const Vec3<double>& s = shape.size;
    if (shape.kind == ShapeKind::plane || shape.kind == ShapeKind::mesh) return 1;
    return shape.kind == ShapeKind::box ? std::max(std::min(s.x, s.y), std::min(std::max(s.x, s.y), s.z)) : s.x;
}

/// No object's surface lies behind a node of the skin: it would have passed through. What is narrower than the distance
/// of two samples may pass between them, as contact is decided at samples.
void check_tunnelling(const Watched& v, Findings& found) {
    const World& w = v.s.world;
    for (const FingerState& f : v.fingers)
        for (const RigidShape& o : w.shapes)
            if (o.stiffness <= 0 && half_width(o.shape) > 0.75 * f.longest_edge() && f.status.converged &&
                !f.status.reset && f.depth_behind_skin(o.shape, o.pose) > 0)
                found.add("nothing passes through skin",
                          text("%.4f s: %s is behind the skin of %s", w.time, o.name.c_str(), f.skin->name.c_str()));
}

/// Where all hands hold still, bodies gain no energy.
void check_energy(const Watched& v, Findings& found) {
    const World& w = v.s.world;
    double now = 0, first = 0, size = 0;
    for (std::size_t o = 0, b = 0; o < w.shapes.size(); ++o) {
        if (w.shapes[o].body < 0) continue;
        now += mechanical_energy(w, w.shapes[o]);
        first += v.first_energy[b++];
        size += w.bodies[w.shapes[o].body].mass * norm(w.gravity) * 0.01;
    }
    if (now > first + 0.02 * size)
        found.add("no energy is gained", text("%.4f s: bodies have %.5g J more than at the start, %.2g mm of height",
                                              w.time, now - first, 10 * (now - first) / size));
}

bool holds_still(const Scene& scene) {
    auto still = [](const std::vector<Keyframe>& track) { return track.size() < 2; };
    for (const FingerMotion& m : scene.finger_motions)
        if (!still(m.keyframes) || m.followed_finger >= 0) return false;
    for (const auto& m : scene.object_motions)
        if (!still(m)) return false;
    return still(scene.hand);
}

/// Normal force of every finger in every step [step][finger], and whether the step was solved to its tolerance.
struct Trace {
    std::vector<std::vector<double>> force;
    std::vector<std::vector<std::uint64_t>> hashes;
    bool all_converged = true;
};

Trace watch(Simulation& s, Findings* found) {
    Trace trace;
    Watched v{s, {}, {}, {}};
    const bool still = holds_still(s.scene);
    for (const RigidShape& shape : s.world.shapes)
        if (shape.body >= 0) v.first_energy.push_back(mechanical_energy(s.world, shape));
    const auto steps = std::max(1L, std::lround(s.scene.duration / s.world.solver.dt));
    for (long k = 0; k < steps; ++k) {
        advance(s);
        v.before = std::move(v.fingers);
        v.fingers = finger_states(s, v.before);
        std::vector<double> forces;
        for (const FingerState& f : v.fingers) {
            forces.push_back(f.normal_force);
            trace.all_converged &= f.status.converged && !f.status.reset;
            if (found && !f.finite())
                found->add("everything stays finite", text("%.4f s: %s", s.world.time, f.skin->name.c_str()));
        }
        trace.force.push_back(std::move(forces));
        trace.hashes.push_back(outcome_of(s).hashes);
        if (!found) continue;
        check_penetration(v, *found);
        check_finger_balance(v, *found);
        check_body_balance(v, *found);
        check_finger_pairs(v, *found);
        check_tunnelling(v, *found);
        if (still && !v.first_energy.empty()) check_energy(v, *found);
    }
    return trace;
}

Pose<double> moved(const Pose<double>& by, const Pose<double>& pose) {
    return {transform(by, pose.position), normalised(by.rotation * pose.rotation)};
}

/// The same scene at another place, turned.
void move_scene(Scene& scene, const Pose<double>& by) {
    const Mat3<double> R = rotation_matrix(by.rotation);
    for (FingerSpec& f : scene.spec.fingers) f.start = moved(by, f.start);
    for (ObjectSpec& o : scene.spec.objects) {
        o.pose = moved(by, o.pose);
        if (!o.body) continue;
        o.body->velocity = R * o.body->velocity;
        o.body->angular_momentum = R * o.body->angular_momentum;
    }
    for (auto& motion : scene.object_motions)
        for (Keyframe& k : motion) k.pose = moved(by, k.pose);
    if (scene.hand.empty()) scene.hand.push_back({0, Pose<double>::identity()});
    for (Keyframe& k : scene.hand) k.pose = moved(by, k.pose);
    scene.spec.gravity = R * scene.spec.gravity;
}

/// Mean difference of two traces' forces, relative to the mean force; 0 where nothing is touched.
double difference(const Trace& a, const Trace& b) {
    double off = 0, all = 0;
    for (std::size_t k = 0; k < std::min(a.force.size(), b.force.size()); ++k)
        for (std::size_t i = 0; i < a.force[k].size(); ++i) {
            off += std::abs(a.force[k][i] - b.force[k][i]);
            all += a.force[k][i];
        }
    return all > 1e-2 * double(a.force.size()) ? off / all : 0;
}

bool has_bodies(const Scene& scene) {
    return std::any_of(scene.spec.objects.begin(), scene.spec.objects.end(), [](auto& o) { return bool(o.body); });
}
bool has_friction(const Scene& scene) {
    if (scene.spec.objects.empty() && scene.spec.fingers_touch && scene.spec.skin_friction > 0) return true;
    return std::any_of(scene.spec.objects.begin(), scene.spec.objects.end(), [](auto& o) { return o.friction > 0; });
}

/// The same bits for any number of threads.
void compare_threads(const Scene& scene, const Trace& one, Findings& found) {
    Simulation s = make_simulation(scene, 2);
    const Trace two = watch(s, nullptr);
    for (std::size_t k = 0; k < one.hashes.size(); ++k)
        if (one.hashes[k] != two.hashes[k])
            return found.add("the same bits for any number of threads", text("step %zu differs", k + 1));
}

/// Fingers declared in the opposite order feel the same, to the last bit where no body passes forces on.
void compare_order(const Scene& scene, const Trace& forward, Findings& found) {
    if (scene.spec.fingers.size() < 2 || has_bodies(scene) || !scene.spec.thimbles.empty()) return;
    Scene reversed = scene;
    std::reverse(reversed.spec.fingers.begin(), reversed.spec.fingers.end());
    std::reverse(reversed.finger_motions.begin(), reversed.finger_motions.end());
    for (FingerFriction& f : reversed.spec.finger_frictions) f.finger = int(scene.spec.fingers.size()) - 1 - f.finger;
    Simulation s = make_simulation(std::move(reversed), 1);
    const Trace backward = watch(s, nullptr);
    // What passes between fingers is reckoned with its plane's axes turned: equal, but for the last bits.
    if (s.world.body_solve.places > 0) return;
    for (std::size_t k = 0; k < forward.force.size(); ++k)
        for (std::size_t i = 0; i < forward.force[k].size(); ++i) {
            const double a = forward.force[k][i], b = backward.force[k][backward.force[k].size() - 1 - i];
            if (a != b && std::isfinite(a))
                return found.add(
                    "order of declaration makes no difference",
                    text("step %zu: %.9g N of %s become %.9g N", k + 1, a, scene.spec.fingers[i].name.c_str(), b));
        }
}

/// Turned and far away, the same is felt.
void compare_moved(const Scene& scene, const Trace& here, Findings& found) {
    if (has_bodies(scene) || has_friction(scene) || scene.preset != 3) return;
    Scene far = scene;
    move_scene(far, {{9.7, -3.2, 4.1}, from_roll_pitch_yaw(0.3, -0.7, 2.1)});
    Simulation s = make_simulation(std::move(far), 1);
    const Trace there = watch(s, nullptr);
    const double off = difference(here, there);
    if (off > 0.01 && here.all_converged && there.all_converged)
        found.add("place and direction make no difference", text("forces differ by %.3g %%", 100 * off));
}

/// Half the step: close to the same where nothing sticks or rolls away.
void compare_step(const Scene& scene, const Trace& coarse, Findings& found) {
    if (has_bodies(scene) || has_friction(scene) || scene.preset != 3 || scene.spec.solver.dt > 0.0051) return;
    Scene finer = scene;
    finer.spec.solver.dt *= 0.5;
    Simulation s = make_simulation(std::move(finer), 1);
    Trace fine = watch(s, nullptr);
    for (std::size_t k = 0; 2 * k + 1 < fine.force.size(); ++k) fine.force[k] = fine.force[2 * k + 1];
    fine.force.resize(coarse.force.size());
    const double off = difference(coarse, fine);
    if (off > 0.25 && coarse.all_converged && fine.all_converged)
        found.add("half the step gives nearly the same", text("forces differ by %.3g %%", 100 * off));
}

}  // namespace

std::vector<Violation> broken_laws(const std::filesystem::path& file, FingerTemplates* templates) {
    const Scene scene = load_scene(file, {}, templates);
    Findings found;
    Simulation s = make_simulation(scene, 1);
    const Trace trace = watch(s, &found);
    compare_threads(scene, trace, found);
    compare_order(scene, trace, found);
    compare_moved(scene, trace, found);
    compare_step(scene, trace, found);
    return found.all;
}

}  // namespace palpate
