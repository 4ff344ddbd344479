#include <algorithm>
#include <cmath>
#include <numbers>
#include <set>

#include "meshes/input_error.h"
#include "meshes/surface.h"
#include "scenes/fingers/finger_model.h"
#include "scenes/load_devices.h"
#include "scenes/presets.h"
#include "scenes/scene.h"
#include "scenes/section.h"
#include "scenes/trackers/hand_source.h"

namespace palpate {

namespace {

constexpr double mm = 1e-3, ms = 1e-3, kPa = 1e3, degree = std::numbers::pi / 180;

Pose<double> read_pose(Section& s, double bound_mm = 5000) {
    const Vec3<double> p = s.vector("position_mm", {0, 0, 0}, bound_mm, mm);
    const Vec3<double> r = s.vector("rotation_deg", {0, 0, 0}, 3600, degree);
    return {p, from_roll_pitch_yaw(r.x, r.y, r.z)};
}

std::vector<Keyframe> read_track(Section& owner) {
    std::vector<Keyframe> track;
    for (Section& s : owner.tables("track")) {
        Keyframe k;
        if (!s.has("t_s")) s.complain("t_s", "a keyframe needs its time");
        k.time = s.number("t_s", track.empty() ? 0 : track.back().time, 0, 1e5);
        const Pose<double> before = track.empty() ? Pose<double>::identity() : track.back().pose;
        k.pose = read_pose(s);
        if (!s.has("position_mm")) k.pose.position = before.position;
        if (!s.has("rotation_deg")) k.pose.rotation = before.rotation;
        if (!track.empty() && k.time <= track.back().time)
            s.complain("t_s", "keyframes must follow each other in time");
        s.finish();
        track.push_back(k);
    }
    return track;
}

void read_solver(Section s, Scene& scene) {
    SolverSettings& v = scene.spec.solver;
    std::vector<std::string> presets = preset_names();
    presets.emplace_back("real-time");  // an older name of "balanced"
    const std::string preset = s.choice("preset", "reference", presets);
    const auto place = std::find(presets.begin(), presets.end(), preset == "real-time" ? "balanced" : preset);
    scene.preset = int(place - presets.begin());
    apply_preset(scene.preset, v);
    scene.deadline = s.number("deadline_ms", 0, 0, 1e4, ms);
    v.newton_iterations = s.integer("newton_iterations", v.newton_iterations, 1, 10000);
    v.tolerance = s.number("tolerance", v.tolerance, 1e-12, 0.1);
    v.multiplier_tolerance = s.number("multiplier_tolerance", v.multiplier_tolerance, 1e-12, 0.1);
    v.multiplier_gate = s.number("multiplier_gate", v.multiplier_gate, 1e-6, 1000);
    v.contact_iterations = s.integer("contact_iterations", v.contact_iterations, 0, 100);
    v.sample_refinement = s.integer("sample_refinement", v.sample_refinement, 1, 8);
    v.contact_share = s.number("contact_share", v.contact_share, 0, 1);
    v.limit_tolerance = s.number("limit_tolerance", v.limit_tolerance, 1e-8, 0.5);
    v.contact_tolerance = s.number("contact_tolerance_um", v.contact_tolerance * 1e6, 1e-4, 1e4, 1e-6);
    v.sleep_speed = s.number("sleep_speed_um_per_s", v.sleep_speed * 1e6, 0, 1e4, 1e-6);
    const bool automatic = s.choice("detail", "full", {"full", "auto"}) == "auto";
    const double tolerance = s.number("detail_tolerance_mm", 0.02, 1e-6, 10, mm);
    const double penetration = s.number("detail_penetration_mm", 0.1, 1e-6, 10, mm);
    const double error = s.number("detail_error", 0.01, 0, 1);
    v.detail_tolerance = automatic ? tolerance : 0;
    v.detail_error = automatic ? error : 0;
    v.detail_penetration = automatic ? penetration : 0;
    v.inertia = !s.boolean("static", !v.inertia);
    const bool single = s.choice("precision", "double", {"double", "float"}) == "float";
    for (FingerSpec& f : scene.spec.fingers) f.single_precision = single;
    s.finish();
}

void read_coupling(Section s, Coupling& c) {
    c.stiffness = s.number("stiffness_N_per_mm", c.stiffness * mm, 1e-3, 1e5, 1 / mm);
    c.damping = s.number("damping_Ns_per_m", c.damping, 0, 1e6);
    c.angular_stiffness = s.number("angular_stiffness_Nm_per_rad", c.angular_stiffness, 1e-6, 1e6);
    c.angular_damping = s.number("angular_damping_Nms_per_rad", c.angular_damping, 0, 1e4);
    c.max_force = s.number("max_force_N", c.max_force, 1e-3, 1e5);
    c.max_speed = s.number("max_speed_m_per_s", c.max_speed, 1e-3, 1e3);
    s.finish();
}

/// [filter]: a one-euro filter of tracked poses; without the table, none.
void read_filter(Section s, std::optional<PoseFilter>& filter) {
    if (!s) return;
    if (!filter) filter.emplace();
    filter->min_cutoff = s.number("min_cutoff_Hz", filter->min_cutoff, 1e-3, 1000);
    filter->speed_factor = s.number("Hz_per_mm_per_s", filter->speed_factor, 0, 100);
    filter->turn_factor = s.number("Hz_per_deg_per_s", filter->turn_factor, 0, 100);
    filter->speed_cutoff = s.number("speed_cutoff_Hz", filter->speed_cutoff, 1e-3, 1000);
    filter->lead = s.number("lead_ms", filter->lead / ms, 0, 200, ms);
    s.finish();
}

/// A closed surface from a file as an object's shape.
void read_object_mesh(Section& s, const std::filesystem::path& folder, ObjectSpec& o) {
    o.shape.kind = ShapeKind::mesh;
    const std::string file = s.text("file", ""), unit = s.choice("unit", "mm", {"m", "cm", "mm"});
    const double smoothing = s.number("smoothing_mm", -1, -1, 100, mm);
    if (file.empty()) return s.complain("file", "a mesh needs the name of a file (.obj, .stl, .ply, .off)");
    try {
        o.mesh = std::make_shared<const DistanceMesh>(build_distance_mesh(
            read_surface((folder / file).lexically_normal(), unit, SurfaceUse::object).surface, smoothing));
        o.shape.mesh = o.mesh.get();
    } catch (const InputError& error) {
        for (const auto& m : error.messages) s.complain("file", m);
    }
}

Shape read_shape(Section& s, const std::string& kind) {
    Shape shape;
    auto length = [&](const char* key, double least) {
        if (!s.has(key)) s.complain(key, "a " + kind + " needs it");
        return s.number(key, 10, least, 10000, mm);
    };
    if (kind == "box") {
        shape.kind = ShapeKind::box;
        if (!s.has("size_mm")) s.complain("size_mm", "a box needs its edge lengths [x, y, z]");
        const Vec3<double> size = s.vector("size_mm", {10, 10, 10}, 10000, mm);
        if (size.x <= 0 || size.y <= 0 || size.z <= 0) s.complain("size_mm", "edge lengths must be positive");
        shape.size = 0.5 * size;
    } else if (kind == "sphere") {
        shape.kind = ShapeKind::sphere;
        shape.size.x = length("radius_mm", 1e-3);
    } else if (kind != "plane") {
        shape.kind = kind == "capsule" ? ShapeKind::capsule : ShapeKind::cylinder;
        shape.size.x = length("radius_mm", 1e-3);
        shape.size.y = 0.5 * length("length_mm", 0);
    }
    return shape;
}

/// mass_g or density_kg_per_m3 make an object one that forces move.
void read_body(Section& s, ObjectSpec& o) {
    if (!s.has("mass_g") && !s.has("density_kg_per_m3")) {
        for (const char* key : {"restitution", "velocity_m_per_s", "spin_rad_per_s", "release_s"})
            if (s.has(key)) s.complain(key, "only an object with mass_g or density_kg_per_m3 moves by itself");
        return;
    }
    if (s.has("mass_g") && s.has("density_kg_per_m3")) s.complain("mass_g", "give the mass or the density, not both");
    if (o.shape.kind == ShapeKind::plane) s.complain("mass_g", "a plane has no end, and so no mass");
    const double density = s.number("density_kg_per_m3", 1000, 1e-3, 1e5);
    const double mass = s.number("mass_g", 1e3 * density * volume_of(o.shape), 1e-3, 1e6, 1e-3);
    o.body = solid_body(o.shape, mass);
    o.body->restitution = s.number("restitution", 0, 0, 1);
    o.body->release = s.number("release_s", 0, 0, 1e5);
    o.body->velocity = s.vector("velocity_m_per_s", {0, 0, 0}, 100);
    const Mat3<double> R = rotation_matrix(o.pose.rotation);
    const Vec3<double> spin = s.vector("spin_rad_per_s", {0, 0, 0}, 1000);
    o.body->angular_momentum = R * (o.body->inertia * transposed_times(R, spin));
}

/// [[friction]]: the coefficient of two objects, or of a finger and an object, against each other.
void read_pair_frictions(Section& root, Scene& scene) {
    SceneSpec& spec = scene.spec;
    auto row_of = [](const auto& all, const std::string& name) {
        const auto it = std::find_if(all.begin(), all.end(), [&](auto& o) { return o.name == name; });
        return it == all.end() ? -1 : int(it - all.begin());
    };
    for (Section& s : root.tables("friction")) {
        int object[2], finger[2];
        const char* keys[2] = {"first", "second"};
        for (int k = 0; k < 2; ++k) {
            const std::string name = s.text(keys[k], "");
            object[k] = row_of(spec.objects, name), finger[k] = row_of(spec.fingers, name);
            if (object[k] < 0 && finger[k] < 0)
                s.complain(keys[k], "expected the name of an object or a finger, found \"" + name + "\"");
            if (object[k] >= 0 && finger[k] >= 0)
                s.complain(keys[k], "\"" + name + "\" is both an object and a finger: rename one");
        }
        const double friction = s.number("coefficient", 0.5, 0, 100);
        if (finger[0] >= 0 && finger[1] >= 0) s.complain("second", "two fingers do not touch each other");
        if (object[0] >= 0 && object[0] == object[1]) s.complain("second", "an object does not touch itself");
        s.finish();
        const int f = finger[0] >= 0 ? 0 : 1;
        if (finger[f] >= 0)
            spec.finger_frictions.push_back({finger[f], object[1 - f], friction});
        else
            spec.pair_frictions.push_back({object[0], object[1], friction});
    }
}

void read_objects(Section& root, Scene& scene, const std::filesystem::path& folder) {
    for (Section& s : root.tables("object")) {
        ObjectSpec o;
        o.name = s.text("name", "object " + std::to_string(scene.spec.objects.size()));
        if (o.name.find_first_of("/\\\"\n,") != std::string::npos || o.name.empty())
            s.complain("name", "a name is used for files: no slashes, quotes or commas");
        for (const ObjectSpec& other : scene.spec.objects)
            if (other.name == o.name) s.complain("name", "two objects are called '" + o.name + "'");
        const std::string kind = s.choice("kind", "plane", {"plane", "box", "sphere", "capsule", "cylinder", "mesh"});
        if (kind == "mesh")
            read_object_mesh(s, folder, o);
        else
            o.shape = read_shape(s, kind);
        o.pose = read_pose(s);
        o.friction = s.number("friction", 0, 0, 100);
        o.stiffness = s.number("stiffness_kPa_per_mm", 0, 0, 1e6, kPa / mm);
        if (o.shape.kind != ShapeKind::mesh || o.mesh) read_body(s, o);
        auto track = read_track(s);
        if (!track.empty() && (s.has("position_mm") || s.has("rotation_deg")))
            s.complain("position_mm", "an object has either a pose or a track");
        if (!track.empty() && o.body) s.complain("track", "an object has either a track or a mass that forces move");
        if (!track.empty()) o.pose = track.front().pose;
        s.finish();
        scene.object_motions.push_back(std::move(track));
        scene.spec.objects.push_back(o);
    }
}

/// [recording] replays a hand, [tracker] follows a live one. Which hand's files are read, the fingers say.
struct HandSource {
    std::filesystem::path file;
    int hand = 1;
    bool loop = false, missing = false;
};

HandSource read_hand_source(Section& root, Scene& scene, const std::filesystem::path& folder) {
    HandSource source;
    Section recording = root.table("recording"), tracker = root.table("tracker");
    if (recording && tracker) root.complain("tracker", "a scene has either a [recording] or a [tracker]");
    for (Section* s : {&recording, &tracker}) {
        if (!*s) continue;
        source.hand = s->choice("hand", "right", {"left", "right"}) == "right";
        scene.tracker_pose = read_pose(*s);
    }
    if (recording) {
        const std::string file = recording.text("file", "");
        if (file.empty()) recording.complain("file", "expected the name of a recording (.jsonl or .csv)");
        source.file = (folder / file).lexically_normal();
        source.missing = !std::filesystem::is_regular_file(source.file);
        if (!file.empty() && source.missing) recording.complain("file", source.file.string() + ": no such file");
        scene.recording_start = recording.number("start_s", 0, 0, 1e5);
        scene.recording_speed = recording.number("speed", 1, 1e-3, 1e3);
        source.loop = recording.boolean("loop", false);
    }
    if (tracker) {
        scene.tracker = tracker.text("source", "");
        if (const std::string wrong = tracker_problem(scene.tracker); !wrong.empty()) tracker.complain("source", wrong);
    }
    recording.finish(), tracker.finish();
    return source;
}

/// `follow` and what belongs to it.
void read_followed(Section& s, Scene& scene, const HandSource& source, FingerMotion& motion) {
    const std::string follow = s.text("follow", "");
    if (follow.empty()) {
        for (const char* key : {"fit", "hand"})
            if (s.has(key)) s.complain(key, "only a finger that follows a tracked one has it");
        return;
    }
    const auto it = std::find(finger_names.begin(), finger_names.end(), follow);
    if (it == finger_names.end())
        return s.complain("follow", "expected thumb, index, middle, ring or little, found \"" + follow + "\"");
    motion.followed_finger = int(it - finger_names.begin());
    motion.hand = s.choice("hand", hand_names[std::size_t(source.hand)], {"left", "right"}) == "right";
    if (Section fit = s.table("fit")) {
        motion.fit = read_pose(fit);
        fit.finish();
    }
    auto& recording = scene.recordings[std::size_t(motion.hand)];
    if (!scene.tracker.empty() || recording || source.missing) return;
    if (source.file.empty()) return s.complain("follow", "the scene has no [recording] or [tracker] to follow");
    try {
        auto read =
            std::make_shared<HandRecording>(read_hand_recording(source.file, hand_names[std::size_t(motion.hand)]));
        read->loop = source.loop;
        recording = std::move(read);
    } catch (const InputError& error) {
        for (const auto& m : error.messages) s.complain("follow", m);
    }
}

void read_fingers(Section& root, Scene& scene, const std::filesystem::path& folder, const HandSource& hands) {
    FingerTemplates templates;
    FingerModel model;  // of all fingers, as far as the scene's own tables say
    model.mesh.shape = finger_shape("index");
    FingerSpec& common = model.spec;
    read_material(root.table("material"), common);
    read_limits(root.table("limits"), common);
    read_coupling(root.table("coupling"), common.coupling);
    read_filter(root.table("filter"), common.filter);
    std::set<std::string> names;
    for (Section& s : root.tables("finger")) {
        FingerModel m = model;
        FingerSpec& f = m.spec;
        const int index = int(scene.spec.fingers.size());
        f.name = s.text("name", "finger " + std::to_string(index));
        if (f.name.find_first_of("/\\\"\n,") != std::string::npos || f.name.empty())
            s.complain("name", "a name is used for files: no slashes, quotes or commas");
        if (!names.insert(f.name).second) s.complain("name", "two fingers are called '" + f.name + "'");
        if (const std::string named = s.text("finger", ""); !named.empty()) {
            Problems found{scene.file, {}};
            read_named_finger(named, folder, m, found);
            for (const auto& message : found.messages) s.complain("finger", message);
        }
        read_finger_model(s, folder, m);
        read_coupling(s.table("coupling"), f.coupling);
        read_filter(s.table("filter"), f.filter);
        FingerMotion motion;
        motion.keyframes = read_track(s);
        read_followed(s, scene, hands, motion);
        std::string note;
        try {
            scene.spec.fingers.push_back(build_finger(m, templates, note));
        } catch (const InputError& error) {
            for (const auto& message : error.messages) s.complain(m.mesh.file.empty() ? "shape" : "mesh", message);
            scene.spec.fingers.push_back(f);
        }
        scene.mesh_notes.push_back(note);
        scene.finger_models.push_back(m);
        scene.finger_motions.push_back(std::move(motion));
        read_device(s.table("device"), index, folder, scene);
        s.finish();
    }
    if (scene.spec.fingers.empty()) root.complain("finger", "a scene needs at least one [[finger]]");
}

void read_scene(const toml::table& table, Scene& scene, Problems& problems) {
    Section root(&table, "", problems);
    const std::filesystem::path folder = scene.file.parent_path();
    scene.title = root.text("title", scene.file.stem().string());
    scene.duration = root.number("duration_s", 1, 1e-3, 1e5);
    scene.spec.solver.dt = root.number("dt_ms", 5, 1e-3, 200, ms);
    Section hand = root.table("hand");
    scene.hand = read_track(hand);
    hand.finish();
    const HandSource hands = read_hand_source(root, scene, folder);
    scene.spec.gravity = root.vector("gravity_m_per_s2", {0, 0, -9.81}, 1000);
    read_objects(root, scene, folder);
    read_fingers(root, scene, folder, hands);
    read_pair_frictions(root, scene);
    read_solver(root.table("solver"), scene);
    read_thimble_loop(root.table("thimbles"), scene);
    root.finish();
    if (problems.messages.empty())
        for (const auto& sentence : scene.spec.validate()) problems.add(nullptr, sentence);
}

}  // namespace

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

Scene load_scene(const std::filesystem::path& file, const std::vector<std::string>& overrides) {
    Scene scene;
    scene.file = file;
    Problems problems{file, {}};
    if (!std::filesystem::is_regular_file(file)) throw InputError(file.string() + ": no such file");
    toml::table table;
    try {
        table = toml::parse_file(file.string());
    } catch (const toml::parse_error& error) {
        const auto& at = error.source().begin;
        throw InputError(file.string() + ":" + std::to_string(at.line) + ":" + std::to_string(at.column) + ": " +
                         std::string(error.description()));
    }
    for (const std::string& o : overrides) apply_override(table, o, problems);
    read_scene(table, scene, problems);
    if (!problems.messages.empty()) throw InputError(problems.messages);
    for (int i = 0; i < int(scene.spec.fingers.size()); ++i) {
        // A finger starts where it is tracked first; one that waits for a live hand, where its track begins.
        TrackerPose::Sample s = tracked_pose(scene, i, 0);
        if (scene.tracker.empty())
            for (double t = 0; !s.valid && t < scene.duration; t += scene.spec.solver.dt) s = tracked_pose(scene, i, t);
        if (!s.valid)
            s.pose = compose(trajectory_pose(scene.hand, 0), trajectory_pose(scene.finger_motions[i].keyframes, 0));
        scene.spec.fingers[i].start = s.pose;
        scene.spec.fingers[i].start.rotation = normalised(s.pose.rotation);
    }
    return scene;
}

}  // namespace palpate
