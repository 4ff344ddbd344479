#include <algorithm>
#include <cmath>
#include <numbers>
#include <set>

#include "meshes/input_error.h"
#include "meshes/surface.h"
#include "scenes/finger_mesh.h"
#include "scenes/load_devices.h"
#include "scenes/scene.h"
#include "scenes/section.h"

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

/// Settings of the solve by preset; measured in the README's speed-accuracy table.
void read_solver(Section s, Scene& scene) {
    SolverSettings& v = scene.spec.solver;
    const std::string preset =
        s.choice("preset", "reference", {"reference", "accurate", "balanced", "real-time", "fast"});
    if (preset != "reference") {
        v.newton_iterations = preset == "accurate" ? 6 : preset == "fast" ? 1 : 2;
        v.tolerance = 1e-4;
        v.multiplier_tolerance = 1e-3;
    }
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
    v.inertia = !s.boolean("static", !v.inertia);
    const bool single = s.choice("precision", "double", {"double", "float"}) == "float";
    for (FingerSpec& f : scene.spec.fingers) f.single_precision = single;
    s.finish();
}

/// Material and limits: of one finger, or of all where the scene's own tables give them.
void read_material(Section s, FingerSpec& f) {
    const std::vector<std::string> kinds{"corotational", "st-venant-kirchhoff", "neo-hookean"};  // as Material has them
    const std::string kind = s.choice("kind", kinds[std::size_t(f.material)], kinds);
    f.material = Material(std::find(kinds.begin(), kinds.end(), kind) - kinds.begin());
    f.young_modulus = s.number("young_kPa", f.young_modulus / kPa, 1e-3, 1e6, kPa);
    f.poisson_ratio = s.number("poisson", f.poisson_ratio, 0, 0.4999);
    f.density = s.number("density_kg_per_m3", f.density, 1, 1e5);
    s.finish();
}

void read_limits(Section s, FingerSpec& f) {
    if (!s) return;
    f.has_limits = s.boolean("enabled", true);
    f.limit_low = s.number("low", f.limit_low, 0, 1);
    f.limit_high = s.number("high", f.limit_high, 1, 100);
    if (f.limit_low >= 1 || f.limit_high <= 1)
        s.complain("low", "limits must leave room around the rest shape: low < 1 < high");
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

FingerMeshRequest read_mesh_request(Section& s, const std::filesystem::path& folder) {
    FingerMeshRequest r;
    Section shape = s.table("shape");
    const std::string preset =
        shape ? shape.choice("finger", "index", {"thumb", "index", "middle", "ring", "little"}) : "index";
    r.shape = finger_shape(preset);
    r.shape.length = shape.number("length_mm", r.shape.length / mm, 10, 60, mm);
    r.shape.width = shape.number("width_mm", r.shape.width / mm, 6, 40, mm);
    r.shape.thickness = shape.number("thickness_mm", r.shape.thickness / mm, 6, 35, mm);
    r.shape.pad_bulge = shape.number("pad_bulge", r.shape.pad_bulge, 0, 0.5);
    r.shape.nail_drop = shape.number("nail_drop", r.shape.nail_drop, 0, 0.5);
    shape.finish();

    Section file = s.table("mesh");
    if (file) {
        const std::string surface = file.text("surface", ""), tets = file.text("tets", "");
        if (surface.empty() == tets.empty())
            file.complain("surface", "expected either surface = \"...\" or tets = \"...\"");
        if (shape) file.complain("surface", "a finger has either a shape or a mesh, not both");
        r.source = tets.empty() ? FingerMeshRequest::Source::surface : FingerMeshRequest::Source::tets;
        r.file = (folder / (tets.empty() ? surface : tets)).lexically_normal().string();
        if (file.has("unit")) r.unit = file.choice("unit", "mm", {"m", "cm", "mm"});
        r.keep_frame = file.boolean("keep_frame", false);
    }
    file.finish();
    r.elements = s.integer("elements", r.elements, 20, 200000);

    Section bone = s.table("bone");
    r.bone_nodes = bone.integers("nodes");
    r.half_space = bone.has("normal");
    const Vec3<double> n = bone.vector("normal", {0, 0, 1}, 1e3);
    r.half_space_normal = {n.x, n.y, n.z};
    r.half_space_offset = bone.number("offset_mm", 0, -1000, 1000, mm);
    r.regions.nail = bone.number("nail", r.regions.nail, 0, 1);
    r.regions.cut = bone.number("cut", r.regions.cut, 0, 1);
    r.regions.phalanx_length = bone.number("phalanx_length", r.regions.phalanx_length, 0, 1);
    r.regions.phalanx_height = bone.number("phalanx_height", r.regions.phalanx_height, 0, 1);
    r.regions.phalanx_radius = bone.number("phalanx_radius", r.regions.phalanx_radius, 0, 1);
    bone.finish();
    return r;
}

/// [filter]: a one-euro filter of tracked poses; without the table, none.
void read_filter(Section s, std::optional<PoseFilter>& filter) {
    if (!s) return;
    if (!filter) filter.emplace();
    filter->min_cutoff = s.number("min_cutoff_Hz", filter->min_cutoff, 1e-3, 1000);
    filter->speed_factor = s.number("Hz_per_mm_per_s", filter->speed_factor, 0, 100);
    filter->turn_factor = s.number("Hz_per_deg_per_s", filter->turn_factor, 0, 100);
    filter->speed_cutoff = s.number("speed_cutoff_Hz", filter->speed_cutoff, 1e-3, 1000);
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
        for (const char* key : {"restitution", "velocity_m_per_s", "spin_rad_per_s"})
            if (s.has(key)) s.complain(key, "only an object with mass_g or density_kg_per_m3 moves by itself");
        return;
    }
    if (s.has("mass_g") && s.has("density_kg_per_m3")) s.complain("mass_g", "give the mass or the density, not both");
    if (o.shape.kind == ShapeKind::plane) s.complain("mass_g", "a plane has no end, and so no mass");
    const double density = s.number("density_kg_per_m3", 1000, 1e-3, 1e5);
    const double mass = s.number("mass_g", 1e3 * density * volume_of(o.shape), 1e-3, 1e6, 1e-3);
    o.body = solid_body(o.shape, mass);
    o.body->restitution = s.number("restitution", 0, 0, 1);
    o.body->velocity = s.vector("velocity_m_per_s", {0, 0, 0}, 100);
    const Mat3<double> R = rotation_matrix(o.pose.rotation);
    const Vec3<double> spin = s.vector("spin_rad_per_s", {0, 0, 0}, 1000);
    o.body->angular_momentum = R * (o.body->inertia * transposed_times(R, spin));
}

/// [[friction]]: the coefficient of two objects against each other.
void read_pair_frictions(Section& root, Scene& scene) {
    for (Section& s : root.tables("friction")) {
        PairFriction p;
        for (auto [key, row] : {std::pair{"first", &p.a}, std::pair{"second", &p.b}}) {
            const std::string name = s.text(key, "");
            const auto& objects = scene.spec.objects;
            const auto it = std::find_if(objects.begin(), objects.end(), [&](auto& o) { return o.name == name; });
            if (it == objects.end()) s.complain(key, "expected the name of an object, found \"" + name + "\"");
            *row = int(it - objects.begin());
        }
        p.friction = s.number("coefficient", 0.5, 0, 100);
        s.finish();
        scene.spec.pair_frictions.push_back(p);
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

void read_recording(Section s, Scene& scene, const std::filesystem::path& folder) {
    if (!s) return;
    const std::string file = s.text("file", ""), hand = s.choice("hand", "right", {"left", "right"});
    scene.recording_pose = read_pose(s);
    scene.recording_start = s.number("start_s", 0, 0, 1e5);
    if (file.empty())
        s.complain("file", "expected the name of a recording (.jsonl or .csv)");
    else
        try {
            scene.recording =
                std::make_shared<HandRecording>(read_hand_recording((folder / file).lexically_normal(), hand));
        } catch (const InputError& error) {
            for (const auto& m : error.messages) s.complain("file", m);
        }
    s.finish();
}

void read_fingers(Section& root, Scene& scene, const std::filesystem::path& folder) {
    FingerTemplates templates;
    FingerSpec common;
    read_material(root.table("material"), common);
    read_limits(root.table("limits"), common);
    read_coupling(root.table("coupling"), common.coupling);
    read_filter(root.table("filter"), common.filter);
    std::set<std::string> names;
    for (Section& s : root.tables("finger")) {
        FingerSpec f = common;
        const int index = int(scene.spec.fingers.size());
        f.name = s.text("name", "finger " + std::to_string(index));
        if (f.name.find_first_of("/\\\"\n,") != std::string::npos || f.name.empty())
            s.complain("name", "a name is used for files: no slashes, quotes or commas");
        if (!names.insert(f.name).second) s.complain("name", "two fingers are called '" + f.name + "'");
        read_material(s.table("material"), f);
        read_limits(s.table("limits"), f);
        read_coupling(s.table("coupling"), f.coupling);
        read_filter(s.table("filter"), f.filter);
        FingerMotion motion;
        motion.keyframes = read_track(s);
        const std::string follow = s.text("follow", "");
        if (!follow.empty()) {
            const auto it = std::find(finger_names.begin(), finger_names.end(), follow);
            if (it == finger_names.end())
                s.complain("follow", "expected thumb, index, middle, ring or little, found \"" + follow + "\"");
            else
                motion.recorded_finger = int(it - finger_names.begin());
            if (!scene.recording) s.complain("follow", "the scene has no [recording] to follow");
        }
        if (Section fit = s.table("fit")) {
            if (follow.empty()) s.complain("fit", "only a finger that follows a tracked one is fitted to it");
            motion.fit = read_pose(fit);
            fit.finish();
        }
        const FingerMeshRequest request = read_mesh_request(s, folder);
        std::string note;
        try {
            f.mesh = make_finger_mesh(request, templates, note);
        } catch (const InputError& error) {
            for (const auto& m : error.messages) s.complain(request.file.empty() ? "shape" : "mesh", m);
        }
        scene.mesh_notes.push_back(note);
        scene.spec.fingers.push_back(std::move(f));
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
    read_recording(root.table("recording"), scene, folder);
    scene.spec.gravity = root.vector("gravity_m_per_s2", {0, 0, -9.81}, 1000);
    read_objects(root, scene, folder);
    read_pair_frictions(root, scene);
    read_fingers(root, scene, folder);
    read_solver(root.table("solver"), scene);
    read_thimble_loop(root.table("thimbles"), scene);
    root.finish();
    if (problems.messages.empty())
        for (const auto& sentence : scene.spec.validate()) problems.add(nullptr, sentence);
}

}  // namespace

TrackerPose::Sample tracked_pose(const Scene& scene, int finger, double time) {
    const FingerMotion& motion = scene.finger_motions[finger];
    if (motion.recorded_finger >= 0) {
        TrackerPose::Sample s =
            sample_recording(*scene.recording, motion.recorded_finger, time + scene.recording_start);
        s.time = time;
        if (s.valid) s.pose = compose(compose(scene.recording_pose, s.pose), motion.fit);
        return s;
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
        // A finger starts where it is tracked first.
        TrackerPose::Sample s = tracked_pose(scene, i, 0);
        for (double t = 0; !s.valid && t < scene.duration; t += scene.spec.solver.dt) s = tracked_pose(scene, i, t);
        scene.spec.fingers[i].start = s.pose;
        scene.spec.fingers[i].start.rotation = normalised(s.pose.rotation);
    }
    return scene;
}

}  // namespace palpate
