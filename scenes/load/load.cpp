#include <toml++/toml.h>
#include <cmath>
#include <cstdio>

#include "meshes/finger_shape.h"
#include "meshes/input_error.h"
#include "meshes/surface.h"
#include "scenes/load/find_scene.h"
#include "scenes/load/finger_model.h"
#include "scenes/load/load_devices.h"
#include "scenes/load/load_motion.h"
#include "scenes/load/load_now.h"
#include "scenes/load/load_objects.h"
#include "scenes/load/load_solver.h"
#include "scenes/load/result_files.h"
#include "scenes/load/scene.h"
#include "scenes/load/section.h"
#include "scenes/load/start_overlap.h"

namespace palpate {

namespace {

void read_coupling(Section s, Coupling& c) {
    using namespace coupling_bounds;
    s.number("stiffness_N_per_mm", c.stiffness, unit::N_per_mm, in(unit::N_per_mm, stiffness),
             "Force per distance with which the tracked pose draws the bone.", Likely{0.01, 1e4, "", "N/m"});
    s.number("damping_Ns_per_m", c.damping, unit::Ns_per_m, damping, "Force per speed between tracked pose and bone.");
    s.number("angular_stiffness_Nm_per_rad", c.angular_stiffness, unit::Nm_per_rad, angular_stiffness,
             "Torque per angle with which the tracked pose turns the bone.");
    s.number("angular_damping_Nms_per_rad", c.angular_damping, unit::Nms_per_rad, angular_damping,
             "Torque per angular speed between them.");
    s.number("max_force_N", c.max_force, unit::N, max_force, "The bone is drawn by no more than this.");
    s.number("max_torque_Nm", c.max_torque, unit::Nm, max_torque, "The bone is turned by no more than this.");
    s.number("max_speed_m_per_s", c.max_speed, unit::m_per_s, max_speed,
             "A tracked pose that jumps is followed no faster; such steps are counted.", Likely{0.01, 100, "", "mm/s"});
    s.number("max_spin_deg_per_s", c.max_spin, unit::deg_per_s, in(unit::deg_per_s, max_spin),
             "A tracked pose that flips is followed no faster; such steps are counted.", Likely{60, 1e6, "rad/s", ""});
    s.finish();
}

/// [filter]: a one-euro filter of tracked poses; without the table, none.
void read_filter(Section s, std::optional<PoseFilter>& filter) {
    if (!s) return;
    PoseFilter f = filter.value_or(PoseFilter{});
    s.number("min_cutoff_Hz", f.min_cutoff, unit::Hz, {1e-3, 1000}, "Cutoff of a finger at rest.");
    s.number("Hz_per_mm_per_s", f.speed_factor, unit::Hz_per_mm_per_s, {0, 100}, "Rise of the cutoff with its speed.");
    s.number("Hz_per_deg_per_s", f.turn_factor, unit::Hz_per_deg_per_s, {0, 100}, "And with that of its rotation.");
    s.number("speed_cutoff_Hz", f.speed_cutoff, unit::Hz, {1e-3, 1000}, "Cutoff of the speeds' own low-pass.");
    s.number("lead_ms", f.lead, unit::ms, {0, 200}, "How far ahead of the samples poses are extrapolated.");
    s.finish();
    if (s.in_file()) filter = f;
}

constexpr const char* coupling_sentence = "Virtual coupling from tracked pose to bone.";
constexpr const char* filter_sentence = "One-euro filter of tracked poses; without this table there is none.";

/// [contact]: fingers against each other.
void read_contact(Section s, SceneSpec& spec) {
    spec.fingers_touch = true;
    s.boolean("fingers", spec.fingers_touch, "Whether fingers touch each other; otherwise they pass through.");
    s.number("skin_friction", spec.skin_friction, unit::one, friction_bounds,
             "Coulomb coefficient of one finger against another.");
    s.finish();
}

/// What all fingers have in common, as far as the scene's own tables say.
FingerModel read_common_finger(Section& root) {
    FingerModel model;
    model.mesh.shape = finger_shape("index");
    read_material(root.table("material", "What the tissue of all fingers is made of."), model.spec);
    read_limits(
        root.table("limits", "Bounds on principal stretches of all fingers; without this table there are none."),
        model.spec);
    read_coupling(root.table("coupling", coupling_sentence), model.spec.coupling);
    read_filter(root.table("filter", filter_sentence), model.spec.filter);
    model.mesh.kind = FingerMeshRequest::Kind::conforming, model.mesh.patch = 5;
    model.mesh.usual = {usual_elements, usual_crease, usual_softening};
    Section mesh =
        root.table("mesh",
                   "How fingers are meshed of which neither they nor their files say it. Without it shapes of "
                   "250 elements and more conform, with patches; all else is uniform.");
    if (mesh) {
        read_how_meshed(mesh, model.mesh);
        mesh.finish();
        if (mesh.has("patch")) model.mesh.scene_patch = model.mesh.patch;
    }
    model.mesh.by_default = !mesh.has("kind");
    return model;
}

void read_finger_preset(Section& s, const std::filesystem::path& folder, FingerModel& m, Scene& scene,
                        Problems& problems) {
    std::string named;
    s.text(
        "finger", named,
        "Shape, tissue and limits from a preset (`palpate list`), or from a file that ends with .toml; the keys here "
        "override it.");
    if (named.empty()) return;
    if (named.ends_with(".toml")) scene.files.push_back(folder / named);
    const FingerMeshRequest plain;  // what a file says nothing of is as it was when it was written
    m.mesh.kind = plain.kind, m.mesh.patch = plain.patch, m.mesh.grading = plain.grading, m.mesh.by_default = false;
    m.mesh.limits_of = FingerMeshRequest::LimitsOf::elements, m.mesh.scene_patch.reset();
    m.mesh.usual = {}, m.mesh.own_elements = m.mesh.own_crease = m.mesh.own_softening = false;
    Problems found{problems.file, {}};
    read_named_finger(named, folder, m, found);
    if (!found.messages.empty()) s.complain_as_found("finger", found.messages);
    for (const auto& warning : found.warnings) problems.warnings.push_back(warning);
    for (const auto& note : found.notes) problems.notes.push_back(note);
}

/// The finger with its mesh. A shape that cannot be meshed to conform where nobody asked for that is uniform.
FingerSpec build_as_can_be(FingerModel& m, FingerTemplates& templates, std::string& note) {
    if (m.mesh.by_default && m.mesh.kind == FingerMeshRequest::Kind::conforming) try {
            return build_finger(m, templates, note);
        } catch (const InputError&) {
            m.mesh.kind = FingerMeshRequest::Kind::uniform, m.mesh.patch = 0;
            m.mesh.limits_of = FingerMeshRequest::LimitsOf::elements;
            FingerSpec uniform = build_finger(m, templates, note);
            note += ", uniform: no sound conforming mesh of this shape was found";
            return uniform;
        }
    return build_finger(m, templates, note);
}

/// A coarse mesh is softer than its tissue (mesh.softening): a modulus that is one of tissue may be none of that.
void check_softened(Section& s, const FingerModel& m, std::size_t elements) {
    const double by = softened_by(m.mesh.softening, elements), lowest = finger_bounds::young_modulus.low;
    const auto text = [&](double modulus) {
        return "expected " + number_text(1.0001 * lowest * by / unit::kPa.si) +
               " kPa or more, for a mesh of so few elements is made softer (moduli are divided by " + number_text(by) +
               "; mesh.softening), found " + number_text(modulus / unit::kPa.si);
    };
    if (m.spec.young_modulus / by < lowest) {
        Section material = s.table("material", "");
        if (material.has("young_kPa")) return material.complain("young_kPa", text(m.spec.young_modulus));
        return s.complain("material", "young_kPa: " + text(m.spec.young_modulus));
    }
    for (const TissueLayer& l : m.layers)
        for (const double modulus : {l.young_modulus, l.modulus_across()})
            if (modulus / by < lowest)
                return s.complain("layer", std::string(modulus == l.young_modulus ? "young_kPa" : "across_kPa") + ": " +
                                               text(modulus));
}

/// A surface of unknown unit that is no fingertip in the guessed one.
void doubt_guessed_unit(Section& s, const FingerModel& m, const TetMesh& mesh) {
    if (m.mesh.source != FingerMeshRequest::Source::surface || !m.mesh.unit.empty()) return;
    const auto box = bounds(mesh.nodes);
    const shape_bounds::Bounds expected[] = {shape_bounds::length, shape_bounds::width, shape_bounds::thickness};
    const auto fits = [&](double scale) {
        for (std::size_t k = 0; k < 3; ++k)
            if (const double size = scale * (box[1][k] - box[0][k]); size < expected[k].low || size > expected[k].high)
                return false;
        return true;
    };
    if (fits(1)) return;
    const auto size = [&](std::size_t k) { return number_text(std::round(1e4 * (box[1][k] - box[0][k])) / 10); };
    s.doubt("mesh", "its unit was guessed from its size: " + size(0) + " x " + size(1) + " x " + size(2) +
                        " mm, which is no fingertip (10 to 60, 6 to 40, 6 to 35 mm)" +
                        (fits(2.54) ? ": it looks like inches (scale it by 25.4 and say unit = \"mm\")"
                                    : "; say its unit = \"mm\", \"cm\" or \"m\" where that is meant"));
}

/// Elements that share no change of volume lock where tissue is nearly incompressible, and press too hard.
void doubt_locking(Section& s, const FingerModel& m) {
    const FingerMeshRequest& r = m.mesh;
    const bool locks = m.spec.poisson_ratio >= locking_poisson_ratio, asked = r.scene_patch.value_or(0) > 0;
    if (m.spec.material == Material::corotational || r.own_patch || r.scene_patch == 0 || !(asked || locks)) return;
    const std::string tissue = material_names[std::size_t(m.spec.material)] + " tissue";
    std::string text =
        asked ? "[mesh] patch = " + std::to_string(*r.scene_patch) + " is not taken by finger \"" + m.spec.name +
                    "\": " + tissue + " has no patches, only corotational tissue does"
              : tissue + " of finger \"" + m.spec.name + "\" has no patches, which corotational tissue has by default";
    if (locks)
        text += "; with poisson = " + number_text(m.spec.poisson_ratio) +
                " its elements lock: it presses too hard (347 elements 0.3 mm deep: 1.3 times at 0.45, 1.5 at 0.49, "
                "2.5 at 0.499). Use corotational tissue, more elements, or a smaller poisson";
    s.doubt("material", text + "; where that is meant, say mesh = { patch = 0 } of the finger");
}

/// The finger with its mesh; where there is none, its problems are the section's.
void add_finger(Section& s, FingerModel m, FingerTemplates& templates, Scene& scene) {
    std::string note;
    try {
        scene.spec.fingers.push_back(build_as_can_be(m, templates, note));
        const FingerSpec& built = scene.spec.fingers.back();
        check_softened(s, m, built.mesh.tets.size());
        if (const std::string wrong = too_stiff_a_layer(m, built); !wrong.empty()) s.complain("layer", wrong);
        doubt_guessed_unit(s, m, built.mesh);
        doubt_locking(s, m);
        constexpr std::size_t fewest_touching = 6;
        if (const std::size_t n = built.mesh.pad_nodes.size(); n < fewest_touching)
            s.doubt("bone", "so much of the finger rides on the bone that only " + std::to_string(n) +
                                " of its nodes can touch anything (bone.nail, bone.cut)");
    } catch (const InputError& error) {
        s.complain_as_found(m.mesh.file.empty() ? "shape" : "mesh", error.messages);
        scene.spec.fingers.push_back(m.spec);
    }
    if (!m.mesh.file.empty()) scene.files.emplace_back(m.mesh.file);
    scene.mesh_notes.push_back(note);
    scene.finger_models.push_back(m);
}

void read_fingers(Section& root, Scene& scene, const std::filesystem::path& folder, const HandSource& hands,
                  FingerTemplates& templates, Problems& problems) {
    const FingerModel model = read_common_finger(root);
    std::vector<std::string> names;
    for (Section& s : root.tables("finger", "A finger: its pad, what moves it, and its thimble.")) {
        FingerModel m = model;
        FingerSpec& f = m.spec;
        const int index = int(scene.spec.fingers.size());
        f.name = "finger " + std::to_string(index);
        s.text("name", f.name, "What it is called in messages and results.");
        check_name(s, f.name, names, "fingers");
        names.push_back(f.name);
        read_finger_preset(s, folder, m, scene, problems);
        read_finger_model(s, folder, m);
        read_coupling(s.table("coupling", coupling_sentence), f.coupling);
        read_filter(s.table("filter", filter_sentence), f.filter);
        FingerMotion motion;
        motion.keyframes = read_track(s, "Poses over time, relative to [hand]'s.");
        read_followed(s, scene, hands, motion);
        scene.finger_motions.push_back(std::move(motion));
        Section device = s.table("device", "The thimble that it wears; without this table, none.");
        if (s.in_file()) add_finger(s, m, templates, scene);
        read_device(device, index, s.in_file() ? scene.spec.fingers.back().mesh : TetMesh{}, folder, scene);
        s.finish();
    }
    if (root.in_file() && root.sound("finger") && scene.spec.fingers.empty())
        root.complain("finger", "a scene needs at least one [[finger]]");
}

void read_scene(Section& root, Scene& scene, FingerTemplates& templates, Problems& problems) {
    const std::filesystem::path folder = scene.file.parent_path();
    scene.title = scene.file.stem().string();
    root.text("title", scene.title, "What it is called in summaries and pictures.");
    root.number("duration_s", scene.duration, unit::s, {1e-3, 1e5}, "Simulated time of a run.",
                Likely{0, 3600, "", "ms"});
    SolverSettings& solver = scene.spec.solver;
    root.number("dt_ms", solver.dt, unit::ms, in(unit::ms, solver_bounds::dt), "Time step of the simulation.",
                Likely{0.02, 50, "seconds", "microseconds"});
    if (Section hand = root.table("hand", "What moves all fingers together.")) {
        scene.hand = read_track(hand, "Poses over time; a finger's own track is relative to them.");
        hand.finish();
    }
    const HandSource hands = read_hand_source(root, scene, folder);
    root.vector("gravity_m_per_s2", scene.spec.gravity, unit::m_per_s2, 1000, "Gravity, on bodies.");
    read_objects(root, scene, folder, templates);
    read_fingers(root, scene, folder, hands, templates, problems);
    read_pair_frictions(root, scene);
    read_contact(root.table("contact", "Fingers against each other."), scene.spec);
    read_solver(root.table("solver", "How the skin is solved: accuracy against time."), scene);
    if (Section picture = root.table(
            "picture", "Scales of pictures, films, reports and views; what it leaves out is as the run has it.")) {
        std::optional<double> pressure, force;
        picture.number("pressure_kPa", pressure, unit::kPa, {0.01, 1e6}, "Where colours of contact pressure end.");
        picture.number("force_N", force, unit::N, {1e-3, 1e6}, "Force whose arrow is longest.");
        scene.scale_pressure = pressure.value_or(0), scene.scale_force = force.value_or(0);
        picture.finish();
    }
    read_thimble_loop(root.table("thimbles", "What the loops of all thimbles share."), scene);
    root.finish();
}

}  // namespace

void print_warnings(const Scene& scene) {
    for (const auto& w : scene.warnings) std::fprintf(stderr, "warning: %s\n", w.c_str());
    for (const auto& n : scene.notes) std::fprintf(stderr, "note: %s\n", n.c_str());
}

KeyInfo scene_keys() {
    KeyInfo keys;
    keys.name = "scene";
    keys.sentence = "A scene file.";
    Problems none;
    Section root(nullptr, "", none, &keys);
    Scene scene;
    FingerTemplates templates;
    read_scene(root, scene, templates, none);
    return keys;
}

TrackerPose::Sample placed(const Scene& scene, int finger, TrackerPose::Sample s) {
    if (s.valid) s.pose = compose(compose(scene.tracker_pose, s.pose), scene.finger_motions[std::size_t(finger)].fit);
    return s;
}

TrackerPose::Sample tracked_pose(const Scene& scene, int finger, double time) {
    const FingerMotion& motion = scene.finger_motions[finger];
    if (motion.followed_finger >= 0) {
        const auto& recording = scene.recordings[std::size_t(motion.hand)];
        TrackerPose::Sample s;
        if (recording)
            s = sample_recording(*recording, motion.followed_finger,
                                 time * scene.recording_speed + scene.recording_start);
        s.time = time;
        return placed(scene, finger, s);
    }
    TrackerPose::Sample s;
    s.pose = compose(trajectory_pose(scene.hand, time), trajectory_pose(motion.keyframes, time));
    s.time = time;
    s.valid = true;
    return s;
}

namespace {

/// A finger starts where it is tracked first; one that waits for a live hand, where its track begins.
void place_fingers(Scene& scene) {
    for (int i = 0; i < int(scene.spec.fingers.size()); ++i) {
        TrackerPose::Sample s = tracked_pose(scene, i, 0);
        if (scene.tracker.empty())
            for (double t = 0; !s.valid && t < scene.duration; t += scene.spec.solver.dt) s = tracked_pose(scene, i, t);
        if (!s.valid)
            s.pose = compose(trajectory_pose(scene.hand, 0), trajectory_pose(scene.finger_motions[i].keyframes, 0));
        scene.spec.fingers[i].start = s.pose;
        scene.spec.fingers[i].start.rotation = normalised(s.pose.rotation);
    }
}

/// Where a bare name was looked for in vain.
std::string tried_for(const std::filesystem::path& name) {
    std::string tried;
    for (const auto& candidate : scene_candidates(name))
        if (candidate != name) tried += (tried.empty() ? ", nor " : ", ") + candidate.string();
    return tried;
}

void place_now(Scene& scene, const PosesNow& now) {
    for (FingerSpec& f : scene.spec.fingers)
        if (const auto at = now.fingers.find(f.name); at != now.fingers.end()) f.start = at->second;
    for (ObjectSpec& o : scene.spec.objects)
        if (const auto at = now.objects.find(o.name); at != now.objects.end()) o.pose = at->second;
}

Scene load_table(toml::table table, const std::filesystem::path& file, const std::vector<std::string>& overrides,
                 FingerTemplates* templates, const PosesNow* now = nullptr) {
    Scene scene;
    scene.file = file;
    Problems problems{file, {}};
    for (const std::string& o : overrides) apply_override(table, o, problems);
    Section root(&table, "", problems);
    FingerTemplates own;
    read_scene(root, scene, templates ? *templates : own, problems);
    // What is wrong with the whole is said where each part of it is right.
    if (problems.messages.empty()) check_boards(scene, problems);
    if (problems.messages.empty()) check_result_files(scene, table, problems);
    if (problems.messages.empty())
        for (const auto& sentence : scene.spec.validate()) problems.add(nullptr, sentence);
    if (problems.messages.empty()) {
        place_fingers(scene);
        if (now) place_now(scene, *now);
        check_start(scene, problems, now);
    }
    if (!problems.messages.empty()) throw InputError(problems.messages);
    scene.warnings = std::move(problems.warnings);
    scene.notes = std::move(problems.notes);
    return scene;
}

}  // namespace

Scene load_scene(const std::filesystem::path& file, const std::vector<std::string>& overrides,
                 FingerTemplates* templates) {
    if (!std::filesystem::is_regular_file(file)) throw InputError(file.string() + ": no such file" + tried_for(file));
    return load_table(parse_toml(file), file, overrides, templates);
}

Scene load_scene_text(const std::string& text, const std::filesystem::path& file,
                      const std::vector<std::string>& overrides, FingerTemplates* templates) {
    Scene scene = load_table(parse_toml(text, file), file, overrides, templates);
    scene.text = text;
    return scene;
}

Scene load_scene_now(const std::string& text, const std::filesystem::path& file,
                     const std::vector<std::string>& overrides, FingerTemplates* templates, const PosesNow& now) {
    Scene scene = load_table(parse_toml(text, file), file, overrides, templates, &now);
    scene.text = text;
    return scene;
}

}  // namespace palpate
