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
        const double rounding = f.skin->single_precision ? 2e-3 : 1e-4;  // of positions, in forces [N]
        const double residual = std::max(1e-3, 3 * solver.tolerance) * forces + rounding;
        const double violation = 1.01 * solver.limit_tolerance + 1e-6;
        const double penetration = 1.01 * solver.contact_tolerance + 1e-8;
        if (s.residual_N > residual || s.limit_violation > violation || s.penetration_m > penetration ||
            s.wrong_sides > 0)
            found.add("converged means within tolerances",
                      text("%.4f s: %s: residual %.3g of %.3g N, limits exceeded by %.3g, %.3g mm deep, %d wrong sides",
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

/// No object's surface lies inside the tissue behind a node of the skin: it would have passed through. Between nodes
/// faces are flat: what is round, or has an edge, lies inside them by a part of their size.
void check_tunnelling(const Watched& v, Findings& found) {
    const World& w = v.s.world;
    for (const FingerState& f : v.fingers) {
        if (!f.status.converged || f.status.reset) continue;
        const double allowed = 0.25 * f.longest_edge();
        for (const RigidShape& o : w.shapes) {
            if (o.stiffness > 0) continue;
            const double depth = f.depth_under_skin(o.shape, o.pose);
            if (depth > allowed)
                found.add("nothing passes through skin", text("%.4f s: %s is %.2f mm under the skin of %s", w.time,
                                                              o.name.c_str(), 1e3 * depth, f.skin->name.c_str()));
        }
    }
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
    std::vector<Vec3<double>> bodies;  ///< where they are in the end, in the order of the objects [m]
    bool all_converged = true;
    bool fingers_near = false;  ///< each other, in some step
};

Trace watch(Simulation& s, Findings* found, RunWriter* recorder = nullptr) {
    Trace trace;
    Watched v{s, {}, {}, {}};
    const bool still = holds_still(s.scene);
    for (const RigidShape& shape : s.world.shapes)
        if (shape.body >= 0) v.first_energy.push_back(mechanical_energy(s.world, shape));
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
            if (found && !f.finite())
                found->add("everything stays finite", text("%.4f s: %s", s.world.time, f.skin->name.c_str()));
        }
        for (const RigidBody& b : s.world.bodies) trace.all_converged &= b.converged && !b.reset;
        trace.force.push_back(std::move(forces));
        trace.hashes.push_back(outcome_of(s).hashes);
        if (!found) continue;
        check_penetration(v, *found);
        check_status(v, *found);
        check_finger_balance(v, *found);
        check_body_balance(v, *found);
        check_finger_pairs(v, *found);
        check_tunnelling(v, *found);
        if (still && !v.first_energy.empty()) check_energy(v, *found);
    }
    if (recorder) recorder->finish();
    for (const RigidShape& shape : s.world.shapes)
        if (shape.body >= 0) trace.bodies.push_back(shape.pose.position);
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

/// Objects declared in the opposite order are felt the same, and bodies end in the same places.
void compare_object_order(const Scene& scene, const Trace& forward, Findings& found) {
    if (scene.spec.objects.size() < 2 || !scene.spec.finger_frictions.empty()) return;
    Scene reversed = scene;
    std::reverse(reversed.spec.objects.begin(), reversed.spec.objects.end());
    std::reverse(reversed.object_motions.begin(), reversed.object_motions.end());
    Simulation s = make_simulation(std::move(reversed), 1);
    Trace backward = watch(s, nullptr);
    std::reverse(backward.bodies.begin(), backward.bodies.end());
    if (!forward.all_converged || !backward.all_converged) return;
    const double off = difference(forward, backward);
    double apart = 0;
    for (std::size_t b = 0; b < std::min(forward.bodies.size(), backward.bodies.size()); ++b)
        apart = std::max(apart, norm(forward.bodies[b] - backward.bodies[b]));
    if ((off > 0.01 && !has_bodies(scene)) || apart > 1e-3)
        found.add("order of objects makes no difference",
                  text("forces differ by %.3g %%, bodies end %.3g mm apart", 100 * off, 1e3 * apart));
}

/// A finger that no other comes near feels, to the last bit, what it feels without them.
void compare_alone(const Scene& scene, const Trace& together, Findings& found) {
    const std::size_t fingers = scene.spec.fingers.size();
    if (fingers < 2 || has_bodies(scene) || together.fingers_near || !scene.spec.thimbles.empty()) return;
    for (const std::size_t i : {std::size_t(0), fingers - 1}) {
        Scene alone = scene;
        alone.spec.fingers = {scene.spec.fingers[i]};
        alone.finger_motions = {scene.finger_motions[i]};
        alone.finger_models = {scene.finger_models[i]};
        std::erase_if(alone.spec.finger_frictions, [&](auto& f) { return f.finger != int(i); });
        for (FingerFriction& f : alone.spec.finger_frictions) f.finger = 0;
        Simulation s = make_simulation(std::move(alone), 1);
        const Trace trace = watch(s, nullptr);
        for (std::size_t k = 0; k < trace.force.size(); ++k)
            if (const double a = together.force[k][i], b = trace.force[k][0]; a != b && std::isfinite(a))
                return found.add("a finger alone feels the same", text("step %zu: %.9g N of %s are %.9g N alone", k + 1,
                                                                       a, scene.spec.fingers[i].name.c_str(), b));
    }
}

/// What goes in, recorded, read and put in again, gives the same bits.
void compare_replay(const Scene& scene, const std::filesystem::path& recording, const Trace& first, Findings& found) {
    const Recording read = read_recording(recording);
    if (read.runs.size() != 1 || !read.losses.empty() || read.runs[0].steps.size() != first.hashes.size())
        return found.add("record and replay are the same", "the recording has lost something");
    Simulation s = make_simulation(scene, 1);
    for (std::size_t k = 0; k < first.hashes.size(); ++k) {
        const RecordedStep& step = read.runs[0].steps[k];
        advance(s, step.inputs);
        if (step.outcome.hashes != first.hashes[k] || outcome_of(s).hashes != first.hashes[k])
            return found.add("record and replay are the same", text("step %zu differs", k + 1));
    }
}

Pose<double> mirrored(const Pose<double>& p) {
    return {{p.position.x, -p.position.y, p.position.z}, {p.rotation.w, -p.rotation.x, p.rotation.y, -p.rotation.z}};
}

/// The same scene behind a mirror, the plane y = 0. Objects are their own mirror images (but meshes).
void mirror_scene(Scene& scene) {
    for (FingerSpec& f : scene.spec.fingers) {
        f.start = mirrored(f.start);
        for (Point& p : f.mesh.nodes) p[1] = -p[1];
        for (Point& n : f.element_normal) n[1] = -n[1];
        for (auto& t : f.mesh.tets) std::swap(t[2], t[3]);
        for (auto& t : f.mesh.surface) std::swap(t[1], t[2]);
    }
    for (ObjectSpec& o : scene.spec.objects) o.pose = mirrored(o.pose);
    for (auto& motion : scene.finger_motions)
        for (Keyframe& k : motion.keyframes) k.pose = mirrored(k.pose);
    for (auto& motion : scene.object_motions)
        for (Keyframe& k : motion) k.pose = mirrored(k.pose);
    for (Keyframe& k : scene.hand) k.pose = mirrored(k.pose);
}

/// A mirrored scene is felt the same.
void compare_mirrored(const Scene& scene, const Trace& here, Findings& found) {
    const auto is_mesh = [](const ObjectSpec& o) { return o.shape.kind == ShapeKind::mesh; };
    if (has_bodies(scene) || has_friction(scene) || scene.preset != 3 || !scene.spec.thimbles.empty()) return;
    if (std::any_of(scene.spec.objects.begin(), scene.spec.objects.end(), is_mesh)) return;
    Scene other = scene;
    mirror_scene(other);
    Simulation s = make_simulation(std::move(other), 1);
    const Trace there = watch(s, nullptr);
    const double off = difference(here, there);
    if (off > 0.01 && here.all_converged && there.all_converged)
        found.add("a mirror makes no difference", text("forces differ by %.3g %%", 100 * off));
}

/// Single and double precision feel the same.
void compare_precision(const Scene& scene, const Trace& here, Findings& found) {
    if (has_bodies(scene) || has_friction(scene) || scene.preset != 3) return;
    Scene other = scene;
    for (FingerSpec& f : other.spec.fingers) f.single_precision = !f.single_precision;
    Simulation s = make_simulation(std::move(other), 1);
    const Trace there = watch(s, nullptr);
    const double off = difference(here, there);
    if (off > 0.01 && here.all_converged && there.all_converged)
        found.add("precision makes little difference", text("forces differ by %.3g %%", 100 * off));
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

/// With `parts` steps for each of the scene's: their mean forces, which are what an implicit step gives.
Trace finer_trace(const Scene& scene, std::size_t parts, std::size_t steps) {
    Scene finer = scene;
    finer.spec.solver.dt /= double(parts);
    Simulation s = make_simulation(std::move(finer), 1);
    Trace trace = watch(s, nullptr);
    for (std::size_t k = 0; parts * (k + 1) <= trace.force.size(); ++k) {
        std::vector<double> mean(trace.force[k].size(), 0.0);
        for (std::size_t part = 0; part < parts; ++part)
            for (std::size_t i = 0; i < mean.size(); ++i) mean[i] += trace.force[parts * k + part][i] / double(parts);
        trace.force[k] = std::move(mean);
    }
    trace.force.resize(steps);
    return trace;
}

/// Half the step: close to the same where nothing sticks or rolls away. A blow that takes a few steps is not resolved
/// by them: where half the step gives something else, a quarter must differ less from the half.
void compare_step(const Scene& scene, const Trace& coarse, Findings& found) {
    if (has_bodies(scene) || has_friction(scene) || scene.preset != 3 || scene.spec.solver.dt > 0.0051) return;
    const Trace half = finer_trace(scene, 2, coarse.force.size());
    const double off = difference(coarse, half);
    if (off <= 0.25 || !coarse.all_converged || !half.all_converged) return;
    const Trace quarter = finer_trace(scene, 4, coarse.force.size());
    const double still_off = difference(half, quarter);
    if (still_off > 0.75 * off && quarter.all_converged)
        found.add("shorter steps come closer", text("forces differ by %.3g %% with half the step, by %.3g %% between "
                                                    "that and a quarter",
                                                    100 * off, 100 * still_off));
}

}  // namespace

std::vector<Violation> broken_laws(const std::filesystem::path& file, FingerTemplates* templates) {
    const Scene scene = load_scene(file, {}, templates);
    Findings found;
    Simulation s = make_simulation(scene, 1);
    const std::filesystem::path recording = file.string() + ".recorded";
    const Trace trace = [&] {
        RunWriter recorder(recording, s, {});
        return watch(s, &found, &recorder);
    }();
    compare_replay(scene, recording, trace, found);
    std::filesystem::remove(recording);
    compare_threads(scene, trace, found);
    compare_order(scene, trace, found);
    compare_object_order(scene, trace, found);
    compare_alone(scene, trace, found);
    compare_precision(scene, trace, found);
    compare_mirrored(scene, trace, found);
    compare_moved(scene, trace, found);
    compare_step(scene, trace, found);
    return found.all;
}

}  // namespace palpate
