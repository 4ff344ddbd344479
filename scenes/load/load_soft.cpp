#include "scenes/load/load_soft.h"

#include <algorithm>
#include <cmath>

#include "engine/bodies/rigid_body.h"
#include "meshes/finger_regions.h"
#include "meshes/input_error.h"
#include "meshes/object_mesh.h"
#include "meshes/patches.h"
#include "meshes/plain_numbers.h"
#include "meshes/remesh.h"
#include "scenes/load/section.h"

namespace palpate {

namespace {

struct Nodule {
    Inclusion place;
    double young_modulus = 0;
};

const std::vector<std::string> sides{"bottom", "top", "left", "right", "back", "front"};  // -z, z, -y, y, -x, x

struct SoftKeys {
    int elements = 1000, patch = 5, fixed = 0;
    double fixed_depth = 0;
    std::vector<Nodule> nodules;
    bool nodules_fit = true;  ///< false: none is meshed, for what is wrong has been said
};

void read_nodules(Section& soft, const ObjectSpec& o, bool shaped, SoftKeys& k) {
    for (Section& s : soft.tables("nodule", "Balls of other tissue inside it; elements end at their surface.")) {
        Nodule n;
        Vec3<double> centre{0, 0, 0};
        s.vector("centre_mm", centre, unit::mm, 10000, "Its centre, in the object's frame.");
        s.number("radius_mm", n.place.radius, unit::mm, {1e-2, 1000}, "Its radius.");
        s.number("young_kPa", n.young_modulus, unit::kPa, in(unit::kPa, finger_bounds::young_modulus),
                 "Its Young's modulus.");
        for (const char* key : {"centre_mm", "radius_mm", "young_kPa"}) s.require(key, "a nodule needs it");
        s.finish();
        for (const char* key : {"centre_mm", "radius_mm", "young_kPa"}) k.nodules_fit &= !s.in_file() || s.sound(key);
        if (!s.in_file() || !shaped || !k.nodules_fit) continue;
        n.place.centre = {centre.x, centre.y, centre.z};
        const double depth = -surface_point(o.shape, Pose<double>::identity(), centre).distance;
        char text[200];
        plain_snprintf(text, sizeof text,
                       "a nodule must lie inside its object: expected a centre deeper below the surface than 1.1 radii "
                       "(%.3g mm), found %.3g mm",
                       1.1e3 * n.place.radius, 1e3 * depth);
        auto complain = [&] { s.complain("centre_mm", text), k.nodules_fit = false; };
        if (!(depth > 1.1 * n.place.radius)) complain();
        for (const Nodule& other : k.nodules) {
            const double apart =
                std::hypot(n.place.centre[0] - other.place.centre[0], n.place.centre[1] - other.place.centre[1],
                           n.place.centre[2] - other.place.centre[2]);
            plain_snprintf(text, sizeof text,
                           "nodules must lie apart: expected centres more than 1.1 times both radii (%.3g mm) apart, "
                           "found %.3g mm",
                           1.1e3 * (n.place.radius + other.place.radius), 1e3 * apart);
            if (!(apart > 1.1 * (n.place.radius + other.place.radius))) complain();
        }
        k.nodules.push_back(n);
    }
}

SurfaceOfSize surface_of(const ObjectSpec& o, const std::shared_ptr<TriangleTree>& file) {
    const Vec3<double> size = o.shape.size;
    switch (o.shape.kind) {
        case ShapeKind::box:
            return [size](double edge) { return box_surface({size.x, size.y, size.z}, edge); };
        case ShapeKind::cylinder:
            return [size](double edge) { return cylinder_surface(size.x, size.y, edge); };
        case ShapeKind::mesh:
            return [file, remesh = std::make_shared<Remesher>(*file)](double edge) { return (*remesh)(edge); };
        default:
            return [size](double edge) { return capsule_surface(size.x, size.y, edge); };
    }
}

/// Nodes that are held: within a depth of one side of the object.
void mark_fixed(TetMesh& mesh, int side, double depth) {
    const auto box = bounds(mesh.nodes);
    const std::size_t axis = std::size_t(2 - side / 2);
    const double size = box[1][axis] - box[0][axis], edge = (side % 2 ? box[1] : box[0])[axis];
    mesh.bone_nodes.clear();
    for (int i = 0; i < int(mesh.nodes.size()); ++i)
        if (std::abs(mesh.nodes[std::size_t(i)][axis] - edge) <= depth + 1e-6 * size) mesh.bone_nodes.push_back(i);
}

/// The mesh, from the templates where it was made before.
ObjectMesh mesh_of(const ObjectSpec& o, const SoftKeys& k, const std::string& file, const std::string& unit,
                   FingerTemplates& templates) {
    std::vector<Inclusion> inclusions;
    std::string key = "soft " + std::to_string(int(o.shape.kind)) + " " + std::to_string(k.elements) + " " + file;
    auto add = [&](double v) {
        char text[40];
        plain_snprintf(text, sizeof text, " %.17g", v);
        key += text;
    };
    for (double v : {o.shape.size.x, o.shape.size.y, o.shape.size.z}) add(v);
    for (const Nodule& n : k.nodules) {
        inclusions.push_back(n.place);
        for (double v : {n.place.centre[0], n.place.centre[1], n.place.centre[2], n.place.radius}) add(v);
    }
    ObjectMesh out;
    if (const auto it = templates.find(key); it != templates.end()) {
        out.mesh = it->second;
        out.inclusion = std::move(out.mesh.patches);  // a template has no patches: they keep its inclusions
        out.mesh.patches.clear();
        return out;
    }
    std::shared_ptr<TriangleTree> tree;
    double filled = volume_of(o.shape);
    if (o.shape.kind == ShapeKind::mesh) {
        const Surface surface = read_surface(file, unit, SurfaceUse::finger).surface;
        tree = std::make_shared<TriangleTree>(surface);
        filled = volume(surface);
    }
    out = mesh_object(surface_of(o, tree), filled, inclusions, {.elements = k.elements});
    TetMesh& kept = templates[key] = out.mesh;
    kept.patches = out.inclusion;
    return out;
}

void fill(Section& s, const SoftKeys& k, const std::string& file, const std::string& unit, FingerTemplates& templates,
          ObjectSpec& o) {
    FingerSpec& f = *o.tissue;
    try {
        const ObjectMesh filled = mesh_of(o, k, file, unit, templates);
        f.mesh = filled.mesh;
        if (!k.nodules.empty())
            for (int in : filled.inclusion)
                f.element_young.push_back(in < 0 ? f.young_modulus : k.nodules[std::size_t(in)].young_modulus);
    } catch (const InputError& error) { return s.complain_as_found("elements", error.messages); }
    mark_fixed(f.mesh, k.fixed, k.fixed_depth);
    const std::size_t held = f.mesh.bone_nodes.size();
    if (held < 3 || held == f.mesh.nodes.size()) {
        char text[240];
        plain_snprintf(text, sizeof text,
                       "expected at least three nodes within fixed_mm of the %s side, and not all %zu of them; found "
                       "%zu within %.3g mm",
                       sides[std::size_t(k.fixed)].c_str(), f.mesh.nodes.size(), held, 1e3 * k.fixed_depth);
        return s.complain(s.has("fixed_mm") ? "fixed_mm" : "fixed", text);
    }
    mark_pad(f.mesh);
    if (k.patch > 0) make_patches(f.mesh, k.patch);
}

}  // namespace

void read_soft(Section& object, bool shaped, const std::string& surface_file, const std::string& file_unit,
               FingerTemplates& templates, ObjectSpec& o) {
    Section s = object.table("soft", "It is tissue, meshed and solved with the fingers; without this table, rigid.");
    if (!s) return;
    FingerSpec f;
    f.name = o.name;
    f.young_modulus = 10e3;
    SoftKeys k;
    s.number("young_kPa", f.young_modulus, unit::kPa, in(unit::kPa, finger_bounds::young_modulus), "Young's modulus.",
             Likely{0.5, 20000, "MPa", "Pa"});
    s.number("poisson", f.poisson_ratio, unit::one, finger_bounds::poisson_ratio, "Poisson's ratio.");
    s.number("density_kg_per_m3", f.density, unit::kg_per_m3, finger_bounds::density, "Density of its tissue.",
             Likely{100, 10000, "g/cm^3", "g/m^3"});
    s.integer("elements", k.elements, {20, 200000}, "Wanted number of tetrahedra; the result is near it.");
    s.integer("patch", k.patch, {0, 16},
              "Elements that share one change of volume, so that nearly incompressible tissue does not lock; 0: none.");
    s.choice("fixed", k.fixed, sides,
             "Side that is held, in the object's frame: bottom and top are -z and z, left and right -y and y, back and "
             "front -x and x.");
    s.number("fixed_mm", k.fixed_depth, unit::mm, {0, 10000},
             "How deep below that side it is held; 0: its face alone.");
    if (Section limits = s.table("limits", "Bounds on its principal stretches; without this table there are none.")) {
        f.has_limits = limits.in_file();
        limits.number("low", f.limit_low, unit::one, finger_bounds::limit_low, "Lower bound.");
        limits.number("high", f.limit_high, unit::one, finger_bounds::limit_high, "Upper bound.");
        limits.finish();
    }
    read_nodules(s, o, shaped && o.shape.kind != ShapeKind::plane, k);
    s.require("fixed", "a soft object is held by a part of it: expected a side, for example fixed = \"bottom\"");
    s.finish();
    if (!s.in_file()) return;
    for (const char* key : {"mass_g", "density_kg_per_m3"})
        if (object.has(key))
            object.complain(key,
                            "a soft object does not move by itself: its fixed part stays, or follows its track; "
                            "remove the mass, or soft (soft has a density_kg_per_m3 of its own)");
    if (object.has("stiffness_kPa_per_mm"))
        object.complain("stiffness_kPa_per_mm", "an object is either tissue (soft) or gives way by itself, not both");
    if (!shaped) return;
    if (o.shape.kind == ShapeKind::plane) return object.complain("soft", "a plane has no end: it cannot be filled");
    for (const char* key : {"elements", "patch", "fixed", "fixed_mm", "nodule"})
        if (!s.sound(key)) return;
    if (!s.has("fixed") || !k.nodules_fit) return;
    o.tissue = f;
    fill(s, k, surface_file, file_unit, templates, o);
    if (!o.tissue->mesh.tets.empty() && o.tissue->mesh.pad_nodes.empty()) o.tissue.reset();
}

}  // namespace palpate
