#include "scenes/load/load_objects.h"

#include <algorithm>
#include <cmath>

#include "meshes/input_error.h"
#include "meshes/surface.h"
#include "scenes/load/load_motion.h"
#include "scenes/load/load_soft.h"

namespace palpate {

namespace {

const std::vector<std::string> kind_words{"plane", "box", "sphere", "capsule", "cylinder", "mesh"};  // as ShapeKind

/// What a file says of an object's shape, whichever kind it is.
struct ShapeKeys {
    ShapeKind kind = ShapeKind::plane;
    std::optional<Vec3<double>> size;
    std::optional<double> radius, length, smoothing;
    std::string file;
    int unit = 2;
};
const std::vector<std::string> unit_words{"m", "cm", "mm"};

ShapeKeys read_shape_keys(Section& s) {
    ShapeKeys k;
    s.choice("kind", k.kind, kind_words,
             "Shape. A plane is the half-space below its z = 0; a box, sphere, capsule or cylinder is centred at its "
             "origin, the last two along their z; a mesh stands in `file`.");
    s.vector("size_mm", k.size, unit::mm, 10000, "Of a box: edge lengths [x, y, z].");
    const Likely metres{0.1, 2000, "metres", "micrometres"};
    s.number("radius_mm", k.radius, unit::mm, {1e-3, 10000}, "Of a sphere, capsule or cylinder.", metres);
    s.number("length_mm", k.length, unit::mm, {0, 10000},
             "Of a capsule or cylinder, along its axis; a capsule's caps come on top.", metres);
    s.text("file", k.file, "Of a mesh: a closed surface (.obj, .stl, .ply, .off), relative to the scene's folder.");
    s.choice("unit", k.unit, unit_words, "Of a mesh: unit of its file.");
    s.number("smoothing_mm", k.smoothing, unit::mm, {0, 100},
             "Of a mesh: cells of the smooth field that skin touches; edges become about as round. 0 is exact. By "
             "default a 48th of its size.");
    return k;
}

/// Keys that belong to some kinds of objects only.
struct Belonging {
    const char* key;
    std::vector<ShapeKind> kinds;
    const char* needed;  ///< why those kinds need it; empty if they do not
};
const std::vector<Belonging> belongings{
    {"size_mm", {ShapeKind::box}, "a box needs its edge lengths [x, y, z]"},
    {"radius_mm",
     {ShapeKind::sphere, ShapeKind::capsule, ShapeKind::cylinder},
     "a sphere, capsule or cylinder needs it"},
    {"length_mm", {ShapeKind::capsule, ShapeKind::cylinder}, "a capsule or cylinder needs it"},
    {"file", {ShapeKind::mesh}, "a mesh needs the name of a file (.obj, .stl, .ply, .off)"},
    {"unit", {ShapeKind::mesh}, ""},
    {"smoothing_mm", {ShapeKind::mesh}, ""},
};

/// Complains about keys of other kinds, and about what this kind lacks.
void check_belongings(Section& s, ShapeKind kind) {
    if (!s.in_file() || !s.sound("kind") || s.misspelt("kind")) return;
    for (const Belonging& b : belongings) {
        const bool belongs = std::find(b.kinds.begin(), b.kinds.end(), kind) != b.kinds.end();
        if (!belongs && s.has(b.key)) s.complain(b.key, "a " + kind_words[std::size_t(kind)] + " has none");
        if (belongs && !s.has(b.key) && *b.needed) s.complain(b.key, b.needed);
    }
}

/// Whether the keys of the shape hold together: otherwise nothing that follows from it is said.
bool make_shape(Section& s, const ShapeKeys& k, const std::filesystem::path& folder, ObjectSpec& o) {
    if (s.misspelt("kind")) return false;
    for (const char* key : {"kind", "size_mm", "radius_mm", "length_mm", "file", "unit", "smoothing_mm"})
        if (!s.sound(key)) return false;
    o.shape.kind = k.kind;
    if (k.kind == ShapeKind::box) {
        o.shape.size = 0.5 * *k.size;
        const Vec3<double>& size = *k.size;
        if (!(size.x > 0 && size.y > 0 && size.z > 0)) {
            s.complain("size_mm", "edge lengths must be positive");
            return false;
        }
        if (const double longest = 1e3 * std::max({size.x, size.y, size.z}); longest < 0.5)
            s.doubt("size_mm", number_text(longest) + " is the longest edge and looks like metres; mm are expected");
    } else if (k.kind == ShapeKind::mesh) {
        try {
            const std::string path = (folder / k.file).lexically_normal();
            o.mesh = std::make_shared<const DistanceMesh>(
                build_distance_mesh(read_surface(path, unit_words[std::size_t(k.unit)], SurfaceUse::object).surface,
                                    k.smoothing.value_or(-1)));
            o.shape.mesh = o.mesh.get();
        } catch (const InputError& error) {
            s.complain_as_found("file", error.messages);
            return false;
        }
    } else if (k.kind != ShapeKind::plane) {
        o.shape.size.x = *k.radius;
        if (k.kind != ShapeKind::sphere) o.shape.size.y = 0.5 * *k.length;
    }
    return true;
}

struct BodyKeys {
    std::optional<double> mass, density;
    double restitution = 0, release = 0;
    Vec3<double> velocity{0, 0, 0}, spin{0, 0, 0};
};

BodyKeys read_body_keys(Section& s) {
    BodyKeys k;
    s.number("mass_g", k.mass, unit::g, {1e-3, 1e6},
             "With a mass (or density) forces move the object; without, it stays, or follows its track.");
    s.number("density_kg_per_m3", k.density, unit::kg_per_m3, {1e-3, 1e5}, "Instead of the mass.",
             Likely{2, 25000, "g/cm^3", "g/m^3"});
    s.number(
        "restitution", k.restitution, unit::one, {0, 1},
        "Share of the speed with which it bounces off other objects. Of two bodies, the larger one's counts for both; "
        "what is no body has none, and fingers bounce nothing off.");
    s.number("release_s", k.release, unit::s, {0, 1e5}, "Until then it stays where it is.");
    s.vector("velocity_m_per_s", k.velocity, unit::m_per_s, 100, "Velocity at the start, of its centre of mass.");
    s.vector("spin_rad_per_s", k.spin, unit::rad_per_s, 1000, "Angular velocity at the start, about the world's axes.");
    return k;
}

/// mass_g or density_kg_per_m3 make an object one that forces move.
void make_body(Section& s, const BodyKeys& k, ObjectSpec& o) {
    if (!s.has("mass_g") && !s.has("density_kg_per_m3")) {
        for (const char* key : {"restitution", "velocity_m_per_s", "spin_rad_per_s", "release_s"})
            if (s.has(key)) s.complain(key, "only an object with mass_g or density_kg_per_m3 moves by itself");
        return;
    }
    const char* given = s.has("mass_g") ? "mass_g" : "density_kg_per_m3";
    if (s.has("mass_g") && s.has("density_kg_per_m3"))
        return s.complain("mass_g", "give the mass or the density, not both");
    if (o.shape.kind == ShapeKind::plane) return s.complain(given, "a plane has no end, and so no mass");
    if (!k.mass && !k.density) return;  // said already
    const double volume = volume_of(o.shape), mass = k.mass ? *k.mass : *k.density * volume;
    if (const double density = mass / volume; k.mass && (density < 2 || density > 50000))
        s.doubt("mass_g", number_text(1e3 * mass) + " g in " + number_text(1e6 * volume) + " cm^3 are " +
                              number_text(density) + " kg/m^3; " +
                              (density < 2 ? "the mass looks like kg: g are expected"
                                           : "the mass or the size is too large or too small"));
    if (norm(k.velocity) > 20)
        s.doubt("velocity_m_per_s", number_text(norm(k.velocity)) + " looks like mm/s; m/s are expected");
    o.body = solid_body(o.shape, mass);
    o.body->restitution = k.restitution;
    o.body->release = k.release;
    o.body->velocity = k.velocity;
    const Mat3<double> R = rotation_matrix(o.pose.rotation);
    o.body->angular_momentum = R * (o.body->inertia * transposed_times(R, k.spin));
}

}  // namespace

void check_name(Section& s, const std::string& name, const std::vector<std::string>& others, const char* what) {
    if (has_controls(name) || name.find_first_of("/\\\",") != std::string::npos || name.empty() || name.size() > 80)
        s.complain(
            "name",
            "a name is used for files: no slashes, quotes, commas or control characters, and at most 80 letters");
    if (std::find(others.begin(), others.end(), name) != others.end())
        s.complain("name", std::string("two ") + what + " are called '" + name + "'");
}

void read_objects(Section& root, Scene& scene, const std::filesystem::path& folder, FingerTemplates& templates) {
    std::vector<std::string> names;
    for (Section& s :
         root.tables("object", "A virtual object: fixed, moved by its track, or a body that forces move.")) {
        ObjectSpec o;
        o.name = "object " + std::to_string(scene.spec.objects.size());
        s.text("name", o.name, "What it is called in messages, results and [[friction]].");
        check_name(s, o.name, names, "objects");
        names.push_back(o.name);
        const ShapeKeys shape = read_shape_keys(s);
        o.pose = read_pose(s, "Where its origin lies in the world.");
        s.number("friction", o.friction, unit::one, friction_bounds,
                 "Coulomb coefficient against skin; against another object the geometric mean of both ([[friction]] "
                 "states others). 0: no friction is built.",
                 Likely{0, 5, "", "per cent"});
        s.number("stiffness_kPa_per_mm", o.stiffness, unit::kPa_per_mm, {0, 1e6},
                 "Pressure on skin per depth of an object that gives way (a Winkler foundation). 0: rigid.");
        const BodyKeys body = read_body_keys(s);
        auto track = read_track(s, "Poses over time of an object that a script moves, instead of a fixed pose.");
        check_belongings(s, shape.kind);
        const bool shaped = make_shape(s, shape, folder, o);
        if (shaped && shape.kind == ShapeKind::mesh) scene.files.push_back(folder / shape.file);
        read_soft(s, shaped && s.in_file(), (folder / shape.file).lexically_normal().string(),
                  unit_words[std::size_t(shape.unit)], templates, o);
        if (shaped && !s.has("soft")) make_body(s, body, o);
        if (!track.empty() && (s.has("position_mm") || s.has("rotation_deg")))
            s.complain(s.has("position_mm") ? "position_mm" : "rotation_deg", "an object has either a pose or a track");
        if (!track.empty() && o.body) s.complain("track", "an object has either a track or a mass that forces move");
        if (!track.empty()) o.pose = track.front().pose;
        s.finish();
        scene.object_motions.push_back(std::move(track));
        scene.spec.objects.push_back(o);
    }
}

void read_pair_frictions(Section& root, Scene& scene) {
    SceneSpec& spec = scene.spec;
    auto row_of = [](const auto& all, const std::string& name) {
        const auto it = std::find_if(all.begin(), all.end(), [&](auto& o) { return o.name == name; });
        return it == all.end() ? -1 : int(it - all.begin());
    };
    std::vector<std::pair<int, int>> pairs;
    for (Section& s : root.tables("friction", "The coefficient of one pair, where it is not that of its objects.")) {
        int object[2], finger[2];
        const char* keys[2] = {"first", "second"};
        for (int k = 0; k < 2; ++k) {
            std::string name;
            s.text(keys[k], name, k == 0 ? "Name of an object or a finger." : "Name of the other one.");
            object[k] = row_of(spec.objects, name), finger[k] = row_of(spec.fingers, name);
            s.require(keys[k], "expected the name of an object or a finger");
            if (object[k] < 0 && finger[k] < 0)
                s.complain(keys[k], "expected the name of an object or a finger, found \"" + name + "\"");
            if (object[k] >= 0 && finger[k] >= 0)
                s.complain(keys[k], "\"" + name + "\" is both an object and a finger: rename one");
        }
        double friction = 0.5;
        s.number("coefficient", friction, unit::one, friction_bounds, "Coulomb coefficient of the two.",
                 Likely{0, 5, "", "per cent"});
        if (finger[0] >= 0 && finger[1] >= 0)
            s.complain("second", "the friction of fingers on each other is skin_friction");
        if (object[0] >= 0 && object[0] == object[1]) s.complain("second", "an object does not touch itself");
        s.finish();
        const auto same = [&](int k) { return object[k] >= 0 ? object[k] : -2 - finger[k]; };
        const std::pair<int, int> pair = std::minmax(same(0), same(1));
        if (std::find(pairs.begin(), pairs.end(), pair) != pairs.end())
            s.complain("second", "this pair has a coefficient already: remove one of the two");
        pairs.push_back(pair);
        const int f = finger[0] >= 0 ? 0 : 1;
        if (finger[f] >= 0)
            spec.finger_frictions.push_back({finger[f], object[1 - f], friction});
        else
            spec.pair_frictions.push_back({object[0], object[1], friction});
    }
}

}  // namespace palpate
