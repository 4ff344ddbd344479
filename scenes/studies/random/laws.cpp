#include "scenes/studies/random/laws.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>
#include <optional>

#include "scenes/studies/random/watched_run.h"

namespace palpate {

namespace {

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

bool has_tissue(const Scene& scene) {
    return std::any_of(scene.spec.objects.begin(), scene.spec.objects.end(), [](auto& o) { return bool(o.tissue); });
}

bool has_limits(const Scene& scene) {
    return std::any_of(scene.spec.fingers.begin(), scene.spec.fingers.end(), [](auto& f) { return f.has_limits; });
}

/// How fast anything is made to move: the fastest point of a track [m/s].
double fastest(const std::vector<Keyframe>& track) {
    double speed = 0;
    for (std::size_t k = 1; k < track.size(); ++k)
        speed = std::max(speed, norm(track[k].pose.position - track[k - 1].pose.position) /
                                    std::max(track[k].time - track[k - 1].time, 1e-9));
    return speed;
}

/// Whether forces of different runs of a scene are to agree: with friction, bodies, or few iterations they need not,
/// nor after a blow. A long step that ends far from where it began may end in more than one place, each of them
/// balanced: what rounds differently finds the other.
bool is_one_solution(const Scene& scene) {
    constexpr double blow = 0.5;  // [m/s]
    double speed = fastest(scene.hand);
    for (const auto& m : scene.finger_motions) speed = std::max(speed, fastest(m.keyframes));
    for (const auto& m : scene.object_motions) speed = std::max(speed, fastest(m));
    return !has_bodies(scene) && !has_friction(scene) && scene.preset == 3 && speed < blow;
}

/// What is compared with another run: what has been found, and what the other runs have cost.
struct Comparisons {
    Findings found;
    double iterations = 0;
    void add(const std::string& law, const std::string& text) { found.add(law, text); }

    Trace run(Scene scene, int threads = 1) {
        Simulation s = make_simulation(std::move(scene), threads);
        Trace trace = watch(s, nullptr);
        iterations += trace.iterations;
        return trace;
    }
};

/// A scene, and what came of it.
struct Run {
    const Scene& scene;
    const Trace& trace;
};

/// A scene whose fingers begin aside.
Scene begun_aside(Scene scene, const Vec3<double>& by) {
    for (FingerSpec& f : scene.spec.fingers) f.start.position = f.start.position + by;
    for (auto& m : scene.finger_motions)
        for (Keyframe& key : m.keyframes) key.pose.position = key.pose.position + by;
    return scene;
}

/// Whether either's forces change by half as much as they differ from the other's where its fingers begin up to a
/// micrometre aside; on tissue four, by which single precision leaves two soft sides apart. Tissue without limits that
/// is pressed on an edge gives way to one side or the other, each of them balanced, and rounding decides: by some
/// scenes in ten thousand. Or, at limits, whether either comes to the other's own forces where it begins a
/// little farther aside: skin that is drawn towards an edge ends before it or snaps over it (1874416). It is said, but
/// breaks no law.
bool have_several_answers(const Run& a, const Run& b, double off, Comparisons& comparisons) {
    const double near = has_tissue(a.scene) ? 4e-6 : 1e-6, farther = 4e-6;  // [m]
    constexpr int directions = 16;
    for (int k = 0; k < 4 * directions; ++k) {
        const Run &run = k % 2 ? b : a, &other = k % 2 ? a : b;
        const bool is_near = k < directions;
        if (!is_near && (&a.trace == &b.trace || !has_limits(a.scene))) break;
        const double turn = 0.125 * std::numbers::pi * k,
                     by = is_near ? near * std::pow(0.5, k % 4) : farther * std::pow(2.0, k / directions);
        const Trace there = comparisons.run(begun_aside(run.scene, {by * std::cos(turn), by * std::sin(turn), by / 3}));
        const double moved = difference(run.trace, there);
        if (!there.all_converged) continue;
        if (is_near ? moved < 0.5 * off : difference(other.trace, there) > 0.25 * off) continue;
        comparisons.add(several_answers,
                        law_text("forces differ by %.3g %% where fingers begin %.3g um aside", 100 * moved, 1e6 * by));
        return true;
    }
    return false;
}

/// Forces of a run that was to give the same.
void compare_forces(const char* law, const Run& here, const Run& there, Comparisons& found) {
    const double off = difference(here.trace, there.trace);
    if (off > 0.01 && here.trace.all_converged && there.trace.all_converged &&
        !have_several_answers(here, there, off, found))
        found.add(law, law_text("forces differ by %.3g %%", 100 * off));
}

/// The same bits for any number of threads.
void compare_threads(const Scene& scene, const Trace& one, Comparisons& found) {
    const Trace two = found.run(scene, 2);
    for (std::size_t k = 0; k < one.hashes.size(); ++k)
        if (one.hashes[k] != two.hashes[k])
            return found.add("the same bits for any number of threads", law_text("step %zu differs", k + 1));
}

/// Fingers declared in the opposite order feel the same, to the last bit where no body passes forces on.
void compare_order(const Scene& scene, const Trace& forward, Comparisons& found) {
    if (scene.spec.fingers.size() < 2 || has_bodies(scene) || has_tissue(scene) || !scene.spec.thimbles.empty()) return;
    Scene reversed = scene;
    std::reverse(reversed.spec.fingers.begin(), reversed.spec.fingers.end());
    std::reverse(reversed.finger_motions.begin(), reversed.finger_motions.end());
    for (FingerFriction& f : reversed.spec.finger_frictions) f.finger = int(scene.spec.fingers.size()) - 1 - f.finger;
    const Trace backward = found.run(std::move(reversed));
    // What passes between fingers is reckoned with its plane's axes turned: equal, but for the last bits.
    if (backward.fingers_near) return;
    for (std::size_t k = 0; k < forward.force.size(); ++k)
        for (std::size_t i = 0; i < forward.force[k].size(); ++i) {
            const double a = forward.force[k][i], b = backward.force[k][backward.force[k].size() - 1 - i];
            if (a != b && std::isfinite(a))
                return found.add(
                    "order of declaration makes no difference",
                    law_text("step %zu: %.9g N of %s become %.9g N", k + 1, a, scene.spec.fingers[i].name.c_str(), b));
        }
}

/// Objects declared in the opposite order are felt the same, and bodies end in the same places; but for what had to be
/// taken out of each other, whose last motion is braked one contact after the other.
void compare_object_order(const Scene& scene, const Trace& forward, Comparisons& found) {
    if (scene.spec.objects.size() < 2 || !scene.spec.finger_frictions.empty()) return;
    Scene reversed = scene;
    std::reverse(reversed.spec.objects.begin(), reversed.spec.objects.end());
    std::reverse(reversed.object_motions.begin(), reversed.object_motions.end());
    Trace backward = found.run(reversed);
    std::reverse(backward.bodies.begin(), backward.bodies.end());
    if (!forward.all_converged || !backward.all_converged) return;
    const double off = difference(forward, backward);
    double apart = 0;
    for (std::size_t b = 0; b < std::min(forward.bodies.size(), backward.bodies.size()); ++b)
        apart = std::max(apart, norm(forward.bodies[b] - backward.bodies[b]));
    const bool forces_differ = off > 0.01 && !has_bodies(scene);
    if (forward.overlapped) apart = 0;
    if (forces_differ && apart <= 1e-3 && have_several_answers({scene, forward}, {reversed, backward}, off, found))
        return;
    if (forces_differ || apart > 1e-3)
        found.add("order of objects makes no difference",
                  law_text("forces differ by %.3g %%, bodies end %.3g mm apart", 100 * off, 1e3 * apart));
}

/// A finger that no other comes near feels, to the last bit, what it feels without them.
void compare_alone(const Scene& scene, const Trace& together, Comparisons& found) {
    const std::size_t fingers = scene.spec.fingers.size();
    if (fingers < 2 || has_bodies(scene) || has_tissue(scene) || together.fingers_near || !scene.spec.thimbles.empty())
        return;
    for (const std::size_t i : {std::size_t(0), fingers - 1}) {
        Scene alone = scene;
        alone.spec.fingers = {scene.spec.fingers[i]};
        alone.finger_motions = {scene.finger_motions[i]};
        alone.finger_models = {scene.finger_models[i]};
        std::erase_if(alone.spec.finger_frictions, [&](auto& f) { return f.finger != int(i); });
        for (FingerFriction& f : alone.spec.finger_frictions) f.finger = 0;
        const Trace trace = found.run(std::move(alone));
        for (std::size_t k = 0; k < trace.force.size(); ++k)
            if (const double a = together.force[k][i], b = trace.force[k][0]; a != b && std::isfinite(a))
                return found.add("a finger alone feels the same",
                                 law_text("step %zu: %.9g N of %s are %.9g N alone", k + 1, a,
                                          scene.spec.fingers[i].name.c_str(), b));
    }
}

/// Where the same scene can be once more, far from itself and not below any plane.
std::optional<Vec3<double>> place_beside(const Scene& scene) {
    constexpr double far = 0.7;  // [m]
    const Vec3<double> all[] = {{far, 0, 0}, {0, 0, far}, {0, far, 0}, {-far, 0, 0}, {0, -far, 0}, {0, 0, -far}};
    const auto is_above = [&](const Vec3<double>& by) {
        return std::none_of(scene.spec.objects.begin(), scene.spec.objects.end(), [&](const ObjectSpec& o) {
            return o.shape.kind == ShapeKind::plane &&
                   dot(rotation_matrix(o.pose.rotation) * Vec3<double>{0, 0, 1}, by) < -1e-9;
        });
    };
    // Beside it, or above it, where fingers touch no plane, and whence nothing may fall.
    const std::size_t first = has_bodies(scene) ? 0 : scene.spec.objects.size() % 2;
    for (std::size_t k = 0; k < std::size(all); ++k)
        if (const Vec3<double>& by = all[(first + k) % std::size(all)]; is_above(by)) return by;
    return std::nullopt;
}

/// A scene and, far away, its fingers and what they touch once more: they share chunks, and each solve goes on until
/// the last one ends.
Scene doubled(const Scene& scene, const Vec3<double>& by) {
    Scene two = scene;
    const Pose<double> away{by, Quaternion<double>::identity()};
    for (std::size_t i = 0; i < scene.spec.fingers.size(); ++i) {
        FingerSpec& f = two.spec.fingers.emplace_back(scene.spec.fingers[i]);
        f.name += " beside";
        f.start = moved(away, f.start);
        for (Keyframe& k : two.finger_motions.emplace_back(scene.finger_motions[i]).keyframes)
            k.pose = moved(away, k.pose);
        two.finger_models.push_back(scene.finger_models[i]);
    }
    for (std::size_t i = 0; i < scene.spec.objects.size(); ++i) {
        if (scene.spec.objects[i].shape.kind == ShapeKind::plane) continue;
        ObjectSpec& o = two.spec.objects.emplace_back(scene.spec.objects[i]);
        o.name += " beside";
        o.pose = moved(away, o.pose);
        for (Keyframe& k : two.object_motions.emplace_back(scene.object_motions[i])) k.pose = moved(away, k.pose);
    }
    return two;
}

/// A scene and, far away, so many copies of its first finger that chunks take turns at work memory.
Scene crowded(const Scene& scene, const Vec3<double>& by) {
    constexpr int copies = 70;
    constexpr double apart = 0.14;  // of that way
    Scene crowd = scene;
    for (int k = 0; k < copies; ++k) {
        const Pose<double> away{(1 + apart * k) * by, Quaternion<double>::identity()};
        FingerSpec& f = crowd.spec.fingers.emplace_back(scene.spec.fingers[0]);
        f.name += law_text(" of the crowd %d", k);
        f.start = moved(away, f.start);
        for (Keyframe& key : crowd.finger_motions.emplace_back(scene.finger_motions[0]).keyframes)
            key.pose = moved(away, key.pose);
        crowd.finger_models.push_back(scene.finger_models[0]);
    }
    return crowd;
}

/// What happens far away changes no bit of a scene: neither what it does itself, nor a crowd.
void compare_beside(const Scene& scene, const Trace& alone, Comparisons& found) {
    if (!scene.hand.empty() || !scene.spec.thimbles.empty() || !scene.spec.finger_frictions.empty()) return;
    const auto by = place_beside(scene);
    if (!by) return;
    for (const bool crowd : {false, true}) {
        const Trace both = found.run(crowd ? crowded(scene, *by) : doubled(scene, *by));
        for (std::size_t k = 0; k < alone.force.size(); ++k)
            for (std::size_t i = 0; i < alone.force[k].size(); ++i)
                if (const double a = alone.force[k][i], b = both.force[k][i]; a != b && std::isfinite(a))
                    return found.add("what is far away changes nothing",
                                     law_text("step %zu: %.17g N of %s are %.17g N beside %s", k + 1, a,
                                              scene.spec.fingers[i].name.c_str(), b, crowd ? "a crowd" : "another"));
    }
}

/// What goes in, recorded, read and put in again, gives the same bits.
void compare_replay(const Scene& scene, const std::filesystem::path& recording, const Trace& first,
                    Comparisons& found) {
    const Recording read = read_recording(recording);
    if (read.runs.size() != 1 || !read.losses.empty() || read.runs[0].steps.size() != first.hashes.size())
        return found.add("record and replay are the same", "the recording has lost something");
    Simulation s = make_simulation(scene, 1);
    for (std::size_t k = 0; k < first.hashes.size(); ++k) {
        const RecordedStep& step = read.runs[0].steps[k];
        advance(s, step.inputs);
        if (step.outcome.hashes != first.hashes[k] || outcome_of(s).hashes != first.hashes[k])
            return found.add("record and replay are the same", law_text("step %zu differs", k + 1));
    }
}

Pose<double> mirrored(const Pose<double>& p) {
    return {{p.position.x, -p.position.y, p.position.z}, {p.rotation.w, -p.rotation.x, p.rotation.y, -p.rotation.z}};
}

Keyframe mirrored(Keyframe k) {
    k.pose = mirrored(k.pose);
    for (Quaternion<double>& q : k.turn) q = mirrored(Pose<double>{{0, 0, 0}, q}).rotation;
    return k;
}

/// The same scene behind a mirror, the plane y = 0. Objects are their own mirror images (but meshes and tissue).
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
        for (Keyframe& k : motion.keyframes) k = mirrored(k);
    for (auto& motion : scene.object_motions)
        for (Keyframe& k : motion) k = mirrored(k);
    for (Keyframe& k : scene.hand) k = mirrored(k);
}

/// A mirrored scene is felt the same.
void compare_mirrored(const Scene& scene, const Trace& here, Comparisons& found) {
    const auto is_mesh = [](const ObjectSpec& o) { return o.shape.kind == ShapeKind::mesh; };
    if (!is_one_solution(scene) || !scene.spec.thimbles.empty()) return;
    if (has_tissue(scene)) return;
    if (std::any_of(scene.spec.objects.begin(), scene.spec.objects.end(), is_mesh)) return;
    Scene other = scene;
    mirror_scene(other);
    const Trace there = found.run(other);
    compare_forces("a mirror makes no difference", {scene, here}, {other, there}, found);
}

/// Single and double precision feel the same.
void compare_precision(const Scene& scene, const Trace& here, Comparisons& found) {
    if (!is_one_solution(scene)) return;
    Scene other = scene;
    for (FingerSpec& f : other.spec.fingers) f.single_precision = !f.single_precision;
    const Trace there = found.run(other);
    compare_forces("precision makes little difference", {scene, here}, {other, there}, found);
}

/// Turned and far away, the same is felt.
void compare_moved(const Scene& scene, const Trace& here, Comparisons& found) {
    if (!is_one_solution(scene)) return;
    Scene far = scene;
    move_scene(far, {{9.7, -3.2, 4.1}, from_roll_pitch_yaw(0.3, -0.7, 2.1)});
    const Trace there = found.run(far);
    compare_forces("place and direction make no difference", {scene, here}, {far, there}, found);
}

/// With `parts` steps for each of the scene's: their mean forces, which are what an implicit step gives.
Trace finer_trace(const Scene& scene, std::size_t parts, std::size_t steps, Comparisons& comparisons) {
    Scene finer = scene;
    finer.spec.solver.dt /= double(parts);
    Trace trace = comparisons.run(std::move(finer));
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
/// by them: where half the step gives something else, still shorter ones must come closer to each other, a quarter and
/// its half at first, an eighth and a sixteenth at last (1786976: 31, 36, 21, 12 and 6 %).
void compare_step(const Scene& scene, const Trace& coarse, Comparisons& found) {
    if (!is_one_solution(scene) || scene.spec.solver.dt > 0.0051) return;
    Trace before = finer_trace(scene, 2, coarse.force.size(), found);
    const double off = difference(coarse, before);
    if (off <= 0.25 || !coarse.all_converged || !before.all_converged) return;
    double still_off = off;
    for (std::size_t parts = 4; parts <= 16; parts *= 2) {
        Trace finer = finer_trace(scene, parts, coarse.force.size(), found);
        still_off = difference(before, finer);
        if (still_off <= 0.75 * off || !finer.all_converged) return;
        before = std::move(finer);
    }
    if (!have_several_answers({scene, coarse}, {scene, coarse}, still_off, found))
        found.add("shorter steps come closer",
                  law_text("forces differ by %.3g %% with half the step, by %.3g %% between an eighth and a sixteenth",
                           100 * off, 100 * still_off));
}

}  // namespace

std::vector<Violation> broken_laws(const std::filesystem::path& file, FingerTemplates* templates,
                                   const LawBudget& budget) {
    const Scene scene = load_scene(file, {}, templates);
    Comparisons found;
    Simulation s = make_simulation(scene, 1);
    const std::filesystem::path recording = file.string() + ".recorded";
    const Trace trace = [&] {
        RunWriter recorder(recording, s, {});
        return watch(s, &found.found, &recorder);
    }();
    auto compare_recorded = [&](const Scene&, const Trace&, Comparisons&) {
        compare_replay(scene, recording, trace, found);
        found.iterations += trace.iterations;
    };
    using Comparison = std::function<void(const Scene&, const Trace&, Comparisons&)>;
    // What a deadline cuts short hangs on the clock: it can be repeated as it was recorded, and that alone.
    std::vector<Comparison> comparisons{compare_recorded, compare_threads, compare_order,     compare_object_order,
                                        compare_alone,    compare_beside,  compare_precision, compare_mirrored,
                                        compare_moved,    compare_step};
    if (scene.deadline > 0) comparisons.resize(1);
    for (std::size_t k = 0; k < comparisons.size() && found.iterations < budget.iterations; ++k)
        comparisons[(budget.first + k) % comparisons.size()](scene, trace, found);
    std::filesystem::remove(recording);
    return found.found.all;
}

}  // namespace palpate
