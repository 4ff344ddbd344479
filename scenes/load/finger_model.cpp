#include "scenes/load/finger_model.h"

#include <toml++/toml.h>
#include <algorithm>
#include <cmath>
#include <sstream>

#include "meshes/finger_presets.h"
#include "meshes/input_error.h"
#include "meshes/layers.h"
#include "meshes/mesh_files.h"
#include "meshes/plain_numbers.h"
#include "scenes/load/section.h"

namespace palpate {

namespace {

constexpr double mm = unit::mm.si, kPa = unit::kPa.si;

const Likely usual_young{0.5, 20000, "MPa", "Pa"};

Range in_file(const Unit& unit, const shape_bounds::Bounds& bounds) { return in(unit, {bounds.low, bounds.high}); }

void read_shape(Section s, FingerMeshRequest& r) {
    if (!s) return;
    if (s.in_file()) r.source = FingerMeshRequest::Source::parametric;
    std::string finger = "index";
    s.choice("finger", finger, finger_shape_names(), "Sizes to begin with, of a median hand.");
    if (s.has("finger")) r.shape = finger_shape(finger);
    s.number("length_mm", r.shape.length, unit::mm, in_file(unit::mm, shape_bounds::length), "Cut to tip.");
    s.number("width_mm", r.shape.width, unit::mm, in_file(unit::mm, shape_bounds::width), "Widest place.");
    s.number("thickness_mm", r.shape.thickness, unit::mm, in_file(unit::mm, shape_bounds::thickness),
             "Pad to nail side, at the cut.");
    s.number("pad_bulge", r.shape.pad_bulge, unit::one, in_file(unit::one, shape_bounds::pad_bulge),
             "Share by which the pad swells at its middle.");
    s.number("nail_drop", r.shape.nail_drop, unit::one, in_file(unit::one, shape_bounds::nail_drop),
             "Share of the dorsal half height lost towards the tip, over the nail.");
    s.number("crease", r.shape.crease, unit::one, in_file(unit::one, shape_bounds::crease),
             "Share of the pad side's height lost towards the cut, as at the crease of the joint behind it. Where a "
             "scene says nothing, 0.22 with a conforming mesh, 0 with a uniform one.");
    r.own_crease = s.has("crease") || (r.own_crease && !s.has("finger"));
    s.finish();
}

/// How a scan lies: directions in the axes of its file.
void read_orientation(Section& mesh, FingerMeshRequest& r) {
    Section o = mesh.table("orientation", "How a surface lies in its file; without it, that is guessed and said.");
    if (!o) return;
    Vec3<double> tip{1, 0, 0}, dorsal{0, 0, 1};
    o.vector("tip", tip, unit::one, 1e6, "Direction of the tip, in the file's axes.");
    o.vector("dorsal", dorsal, unit::one, 1e6, "Direction in which the nail faces, in the file's axes.");
    for (const char* key : {"tip", "dorsal"})
        o.require(key, "expected a direction of the file's axes, for example [0, 0, 1]");
    if (o.in_file()) r.orientation = FingerOrientation{{tip.x, tip.y, tip.z}, {dorsal.x, dorsal.y, dorsal.z}};
    if (o.sound("tip") && o.sound("dorsal") && !(norm(cross(tip, dorsal)) > 1e-3 * norm(tip) * norm(dorsal)))
        o.complain("dorsal", "tip and dorsal must be two directions that are not parallel");
    if (r.keep_frame && o.in_file())
        mesh.complain("keep_frame", "a mesh has either its own frame or an orientation, not both");
    o.finish();
}

}  // namespace

void read_how_meshed(Section& s, FingerMeshRequest& r) {
    s.choice(
        "kind", r.kind, {"uniform", "conforming"},
        "uniform: elements of one size, bone nodes are those that lie in the bone. conforming: small on the pad, large "
        "inside and on the back, between the skin and a phalanx whose surface they share.");
    s.number("coarse", r.grading.coarse, unit::one, {1, 5},
             "Edges on the back over edges on the pad, of a conforming mesh.");
    s.number("bone", r.grading.bone, unit::one, {1, 5}, "Edges on the phalanx over edges on the pad.");
    s.integer(
        "patch", r.patch, {0, 16},
        "Elements that share one change of volume (F-bar), so that nearly incompressible tissue does not lock; 0: "
        "none do. Corotational tissue alone takes them.");
    using LimitsOf = FingerMeshRequest::LimitsOf;
    LimitsOf limited = r.limits_of.value_or(LimitsOf::patches);
    s.choice(
        "limits", limited, {"elements", "patches", "regions"},
        "Whose stretches strain limits hold: each tetrahedron's, or those of the mean deformation of some 70 patches, "
        "which change less with the mesh and saturate less in spots. regions: patches whose bounds are the same in "
        "every mesh, and cut tetrahedra; these go further than with patches. Where nothing is said, patches of "
        "conforming meshes, elements of others.");
    if (s.has("limits")) r.limits_of = limited;
    int curved = r.curved_skin;
    s.choice("skin", curved, {"flat", "curved"},
             "What touches between nodes. flat: the mesh's faces, which are touched later than the skin that they "
             "stand for. "
             "curved: a skin as round as their normals say, as it is deformed.");
    r.curved_skin = curved == 1;
    s.number("softening", r.softening, unit::one, {0, 2},
             "Of coarse meshes, which press too hard: moduli are divided by 1 + softening (347 / tetrahedra)^(2/3). "
             "Usual: of shapes with a conforming mesh 0.04, and 0.04 + 0.08 ln(elements / 400) to 0.12 beyond 400.");
    r.own_softening |= s.has("softening");
    s.number("limit_softening", r.limit_softening, unit::one, {0, 1},
             "Of coarse meshes, which are pressed together to their limits too early: lower limits are raised to the "
             "power of 1 + limit_softening (347 / tetrahedra)^(2/3).");
}

namespace {

/// Usual softening of so many elements: until some 1,000, what is pressed too hard falls more slowly than by (347 /
/// elements)^(2/3) (bench/README.md, "Meshes"). Rounded, so that it is the same when it is written down.
double softening_by_size(double usual, int elements) {
    const double grown = usual + 0.08 * std::log(std::max(elements, usual_elements) / double(usual_elements));
    return usual == 0 ? 0 : std::round(1000 * std::min(grown, 0.12)) / 1000;
}

/// A scene's fingers are conforming where nothing is said; what does not go with that is uniform then: finished meshes,
/// scans (many of which cannot be meshed so), a bone by half-space or by list, fewer elements than it takes; and
/// patches are left out where the tissue is another.
void settle_default_mesh(const Section& mesh, FingerModel& m) {
    FingerMeshRequest& r = m.mesh;
    r.own_patch |= mesh.has("patch");
    const auto settle_limits = [&] {
        const bool corotational = m.spec.material == Material::corotational;
        using LimitsOf = FingerMeshRequest::LimitsOf;
        if (!r.limits_of)
            r.limits_of =
                r.kind == FingerMeshRequest::Kind::conforming && corotational ? LimitsOf::patches : LimitsOf::elements;
        // The scene said it of all fingers.
        if (!mesh.has("limits") && !corotational) r.limits_of = LimitsOf::elements;
    };
    const bool parametric = r.source == FingerMeshRequest::Source::parametric;
    const auto settle_usual = [&] {
        if (!parametric) return;
        const bool conforming = r.kind == FingerMeshRequest::Kind::conforming;
        const FingerMeshRequest::Usual usual = conforming ? r.usual : FingerMeshRequest::Usual{};
        if (!r.own_elements) r.elements = usual.elements;
        if (!r.own_crease) r.shape.crease = usual.crease;
        if (!r.own_softening) r.softening = softening_by_size(usual.softening, r.elements);
    };
    if (!r.by_default) return settle_limits(), settle_usual();
    constexpr int fewest = 250;
    r.by_default = !mesh.has("kind");
    if (r.by_default && (!parametric || r.half_space || !r.bone_nodes.empty() || r.elements < fewest))
        r.kind = FingerMeshRequest::Kind::uniform;
    if (!mesh.has("patch") && (r.kind == FingerMeshRequest::Kind::uniform || m.spec.material != Material::corotational))
        r.patch = 0;
    settle_limits();
    settle_usual();
}

/// What of a mesh does not go together.
void check_mesh(Section& s, Section& mesh, Section& material, const FingerModel& m) {
    const FingerMeshRequest& r = m.mesh;
    if (!mesh.has("patch") && r.patch > 0 && m.spec.material != Material::corotational) {
        const std::string why = "the mesh has patches (of " + std::to_string(r.patch) +
                                " elements each), which need corotational tissue; for " +
                                material_names[std::size_t(m.spec.material)] + ", also say mesh = { patch = 0 }";
        if (material.has("kind")) return material.complain("kind", why);
        if (!mesh) return s.complain("mesh", why);
    }
    if (mesh && r.patch > 0 && m.spec.material != Material::corotational && mesh.sound("patch"))
        mesh.complain("patch", "patches need corotational tissue: material = { kind = \"corotational\" }");
    if (mesh && limits_patches(r) && m.spec.material != Material::corotational && mesh.sound("limits"))
        mesh.complain("limits", "limits of patches need corotational tissue: material = { kind = \"corotational\" }");
    if (r.kind != FingerMeshRequest::Kind::conforming) return;
    if (mesh && r.source == FingerMeshRequest::Source::tets)
        mesh.complain("kind", "a finished mesh (tets) stays as it is; a shape or a surface can be meshed to conform");
    if (r.half_space || !r.bone_nodes.empty())
        s.complain("bone",
                   "the phalanx of a conforming mesh has a shape (phalanx_length, phalanx_height, "
                   "phalanx_radius), no normal and no list of nodes");
}

void read_mesh(Section& s, const std::filesystem::path& folder, FingerModel& m, bool has_shape) {
    if (!s) return;
    FingerMeshRequest& r = m.mesh;
    std::string surface, tets;
    s.text("surface", surface, "A scanned finger: a closed surface (.obj, .stl, .ply, .off), meshed at load.");
    s.text("tets", tets, "Or a finished mesh: TetGen .node/.ele, Gmsh .msh, VTU.");
    read_how_meshed(s, r);
    const bool from_file = !surface.empty() || !tets.empty();
    const bool only_how = s.has("kind") || s.has("coarse") || s.has("bone") || s.has("patch") || s.has("limits") ||
                          s.has("skin") || s.has("softening") || s.has("limit_softening");
    if (!from_file && s.in_file() && !only_how && s.sound("surface") && s.sound("tets"))
        s.complain("surface", "expected either surface = \"...\" or tets = \"...\"");
    if (!surface.empty() && !tets.empty()) s.complain("surface", "expected either surface = \"...\" or tets = \"...\"");
    if (has_shape && from_file) s.complain("surface", "a finger has either a shape or a mesh, not both");
    std::string unit = "mm";
    s.choice("unit", unit, {"m", "cm", "mm"}, "Unit of the file; of a surface it is guessed where it is not said.");
    s.boolean("keep_frame", r.keep_frame,
              "The file's axes are the finger's already (x to the tip, y to the radial side, z from pad to nail): no "
              "orientation is guessed.");
    read_orientation(s, r);
    if (from_file) {
        r.source = tets.empty() ? FingerMeshRequest::Source::surface : FingerMeshRequest::Source::tets;
        r.file = (folder / (tets.empty() ? surface : tets)).lexically_normal().string();
        if (s.has("unit")) r.unit = unit;
    }
    s.finish();
}

void read_bone(Section s, FingerMeshRequest& r) {
    if (!s) return;
    s.integers("nodes", r.bone_nodes, {0, 1e7 - 1}, "Bone nodes by number, from 0.");
    Vec3<double> n{0, 0, 1};
    s.vector("normal", n, unit::one, 1e3,
             "Bone nodes by half-space instead: those on the positive side of a plane with this normal.");
    double offset = 0;
    s.number("offset_mm", offset, unit::mm, {-1000, 1000}, "Place of that plane along its normal.");
    if (s.in_file()) {
        r.half_space = s.has("normal");
        r.half_space_normal = {n.x, n.y, n.z};
        r.half_space_offset = offset;
    }
    if (r.half_space && s.sound("normal") && !(norm(n) > 0)) s.complain("normal", "a plane's normal has a length");
    s.number("nail", r.regions.nail, unit::one, {0, 1},
             "Share of the thickness, from the pad; above it is nail and back.");
    s.number("cut", r.regions.cut, unit::one, {0, 1}, "Share of the length, from the proximal end, that is held.");
    s.number("phalanx_length", r.regions.phalanx_length, unit::one, {0, 1},
             "Share of the length reached by the bone, from the proximal end.");
    s.number("phalanx_height", r.regions.phalanx_height, unit::one, {0, 1},
             "Share of the thickness at which its axis lies.");
    s.number("phalanx_radius", r.regions.phalanx_radius, unit::one, {0, 1}, "Its radius, as a share of the thickness.");
    s.finish();
}

void read_layers(Section& owner, const FingerSpec& below, std::vector<TissueLayer>& layers) {
    auto tables =
        owner.tables("layer", "Layers of tissue from the skin inwards; what is deeper has the finger's own material.");
    if (!tables.empty()) layers.clear();
    for (Section& s : tables) {
        TissueLayer l;
        s.number("thickness_mm", l.thickness, unit::mm, {0.01, 20}, "Thickness of the layer.");
        s.require("thickness_mm", "a layer needs its thickness");
        l.young_modulus = below.young_modulus, l.limit_low = below.limit_low, l.limit_high = below.limit_high;
        s.number("young_kPa", l.young_modulus, unit::kPa, in(unit::kPa, finger_bounds::young_modulus),
                 "Young's modulus; by default that of the finger's material.", usual_young);
        s.number("across_kPa", l.across, unit::kPa, in(unit::kPa, finger_bounds::young_modulus),
                 "Young's modulus across the skin, and the one that counts in shear across it, where it is another: "
                 "skin's fibres lie along it. By default young_kPa.",
                 usual_young);
        if (l.across > l.young_modulus && s.sound("across_kPa") && s.sound("young_kPa"))
            s.complain("across_kPa",
                       "expected no more than young_kPa, for a skin is no stiffer across than along it, found " +
                           number_text(l.across / kPa) + " above " + number_text(l.young_modulus / kPa));
        s.number("low", l.limit_low, unit::one, finger_bounds::limit_low,
                 "Lower bound of its principal stretches; by default that of the finger's limits.");
        s.number("high", l.limit_high, unit::one, finger_bounds::limit_high,
                 "Upper bound of its principal stretches; by default that of the finger's limits.");
        s.finish();
        layers.push_back(l);
    }
}

}  // namespace

void read_material(Section s, FingerSpec& f) {
    s.choice("kind", f.material, material_names, "Elasticity of the tissue.");
    s.number("young_kPa", f.young_modulus, unit::kPa, in(unit::kPa, finger_bounds::young_modulus), "Young's modulus.",
             usual_young);
    s.number("poisson", f.poisson_ratio, unit::one, finger_bounds::poisson_ratio, "Poisson's ratio.");
    s.number("density_kg_per_m3", f.density, unit::kg_per_m3, finger_bounds::density, "Density of the tissue.",
             Likely{100, 10000, "g/cm^3", "g/m^3"});
    s.finish();
}

void read_limits(Section s, FingerSpec& f) {
    if (!s) return;
    bool enabled = true;
    s.boolean("enabled", enabled, "false: none, in spite of the table.");
    if (s.in_file()) f.has_limits = enabled;
    s.number("low", f.limit_low, unit::one, finger_bounds::limit_low, "Lower bound of principal stretches.");
    s.number("high", f.limit_high, unit::one, finger_bounds::limit_high, "Upper bound of principal stretches.");
    s.finish();
}

void read_finger_model(Section& s, const std::filesystem::path& folder, FingerModel& m) {
    Section material = s.table("material", "What the tissue is made of.");
    read_material(material, m.spec);
    read_limits(s.table("limits", "Bounds on principal stretches; without this table there are none."), m.spec);
    Section shape = s.table("shape", "A parametric finger.");
    read_shape(shape, m.mesh);
    Section mesh = s.table("mesh", "How a finger is meshed; a finger from a file, instead of a shape.");
    read_mesh(mesh, folder, m, shape.in_file());
    read_bone(s.table("bone",
                      "Which nodes ride on the bone; by default those at the cut, under the nail and inside the "
                      "phalanx."),
              m.mesh);
    read_layers(s, m.spec, m.layers);
    s.integer("elements", m.mesh.elements, {20, 200000},
              "Tetrahedra wanted, of a shape or a scanned surface. Where a scene says nothing, 400 for shapes with a "
              "conforming mesh.");
    m.mesh.own_elements |= s.has("elements");
    settle_default_mesh(mesh, m);
    check_mesh(s, mesh, material, m);
}

namespace {

void read_finger_file(Section& root, const std::filesystem::path& folder, FingerModel& m) {
    root.text("title", m.title, "What it is.");
    root.text("source", m.source, "Where its numbers come from.");
    read_finger_model(root, folder, m);
}

}  // namespace

KeyInfo finger_file_keys() {
    KeyInfo keys;
    keys.name = "finger-file";
    keys.sentence = "A file that `finger = \"...\"` names: shape and tissue of one finger. Presets are such files.";
    Problems none;
    Section root(nullptr, "", none, &keys);
    FingerModel model;
    read_finger_file(root, {}, model);
    return keys;
}

std::vector<std::string> finger_preset_names() {
    std::vector<std::string> names;
    for (const FingerPreset& p : finger_presets()) names.emplace_back(p.name);
    return names;
}

void read_named_finger(const std::string& name, const std::filesystem::path& folder, FingerModel& m,
                       Problems& problems) {
    const bool is_file = name.size() > 5 && name.ends_with(".toml");
    Problems own{is_file ? (folder / name).lexically_normal() : std::filesystem::path(name), {}};
    try {
        toml::table table;
        if (is_file) {
            table = parse_toml(own.file);
        } else {
            const auto& presets = finger_presets();
            const auto it = std::find_if(presets.begin(), presets.end(), [&](auto& p) { return p.name == name; });
            if (it == presets.end())
                throw InputError("expected the name of a finger (" + joined(finger_preset_names()) +
                                 "), or a file that ends with .toml, found \"" + name + "\"");
            table = toml::parse(it->text);
        }
        Section root(&table, "", own);
        read_finger_file(root, own.file.parent_path(), m);
        root.finish();
    } catch (const InputError& error) {
        own.messages.insert(own.messages.end(), error.messages.begin(), error.messages.end());
    }
    problems.warnings.insert(problems.warnings.end(), own.warnings.begin(), own.warnings.end());
    problems.notes.insert(problems.notes.end(), own.notes.begin(), own.notes.end());
    problems.messages.insert(problems.messages.end(), own.messages.begin(), own.messages.end());
}

void apply_layers(const std::vector<TissueLayer>& layers, FingerSpec& f) {
    f.element_young.clear(), f.element_low.clear(), f.element_high.clear();
    f.element_membrane.clear(), f.element_normal.clear();
    f.skin_modulus = 0;
    if (layers.empty()) return;
    f.skin_modulus = layers.front().modulus_across();
    std::vector<double> thicknesses;
    for (const TissueLayer& l : layers) thicknesses.push_back(l.thickness);
    LayerShares found = layer_shares(f.mesh, thicknesses);
    std::vector<double> moduli;
    for (const TissueLayer& l : layers) moduli.push_back(l.young_modulus);
    for (const std::vector<double>& shares : found.shares) {
        double along = shares.back() * f.young_modulus, across = shares.back() / f.young_modulus,
               low = shares.back() * f.limit_low, high = shares.back() * f.limit_high;
        for (std::size_t k = 0; k < layers.size(); ++k) {
            along += shares[k] * layers[k].young_modulus;
            across += shares[k] / layers[k].modulus_across();
            low += shares[k] * layers[k].limit_low;
            high += shares[k] * layers[k].limit_high;
        }
        f.element_young.push_back(1 / across);
        // A single layer rounds to a membrane of nearly nothing, which would cost as much as one that counts.
        f.element_membrane.push_back(along * across > 1 + 1e-9 ? along - 1 / across : 0);
        f.element_low.push_back(low);
        f.element_high.push_back(high);
    }
    lift_membranes(f.mesh, found.normals, skin_excess(found.shares, thicknesses, moduli, f.young_modulus),
                   f.element_membrane);
    f.element_normal = std::move(found.normals);
}

namespace {

void soften(FingerSpec& f, double by) {
    for (double* modulus : {&f.young_modulus, &f.skin_modulus}) *modulus /= by;
    for (auto* moduli : {&f.element_young, &f.element_membrane})
        for (double& modulus : *moduli) modulus /= by;
}

void lower_limits(FingerSpec& f, double power) {
    if (power <= 1) return;
    const auto lower = [&](double& low) { low = std::max(finger_bounds::limit_low.low, std::pow(low, power)); };
    lower(f.limit_low);
    for (double& low : f.element_low) lower(low);
}

}  // namespace

std::string too_stiff_a_layer(const FingerModel& m, const FingerSpec& built) {
    constexpr double highest = finger_bounds::young_modulus.high;
    double most = 0, stiffest = 0;
    for (double modulus : built.element_membrane) most = std::max(most, modulus);
    for (const TissueLayer& l : m.layers) stiffest = std::max(stiffest, l.young_modulus);
    if (most <= highest) return "";
    return "young_kPa: expected " + number_text(std::floor(0.99 * stiffest * highest / most / kPa)) +
           " or less, for a layer that is thinner than elements are makes those at the skin stiffer than it is, "
           "found " +
           number_text(stiffest / kPa);
}

FingerSpec build_finger(const FingerModel& m, FingerTemplates& templates, std::string& note) {
    FingerSpec f = m.spec;
    FingerMeshRequest request = m.mesh;
    if (!f.has_limits) request.limits_of = FingerMeshRequest::LimitsOf::elements;
    request.layered = !m.layers.empty();
    f.mesh = make_finger_mesh(request, templates, note);
    apply_layers(m.layers, f);
    soften(f, softened_by(request.softening, f.mesh.tets.size()));
    lower_limits(f, softened_by(request.limit_softening, f.mesh.tets.size()));
    // By the squares of lower limits, elements of fine meshes are held before their patch is, the earlier the finer
    // they are; by fourth powers, some steps beyond 20 N do not converge.
    if (request.limits_of == FingerMeshRequest::LimitsOf::regions) f.element_low_power = 3;
    if (!m.layers.empty()) note += ", " + std::to_string(m.layers.size() + 1) + " layers of tissue";
    return f;
}

namespace {

std::string orientation_text(const FingerMeshRequest& r) {
    if (!r.orientation) return "";
    PlainText out;
    auto put = [&](const char* name, const Point& p) {
        out << name << " = [" << p[0] << ", " << p[1] << ", " << p[2] << "]";
    };
    put(", orientation = { tip", r.orientation->tip);
    put(", dorsal", r.orientation->dorsal);
    out << " }";
    return out.str();
}

}  // namespace

void write_finger_file(const std::filesystem::path& path, const FingerModel& m,
                       const std::vector<std::string>& comment) {
    PlainText out;
    auto quoted = [](const std::string& s) {
        PlainText text;
        text << toml::value<std::string>(s);
        return text.str();
    };
    out.precision(6);
    for (const std::string& line : comment) out << "# " << line << "\n";
    if (!m.title.empty()) out << "title = " << quoted(m.title) << "\n";
    if (!m.source.empty()) out << "source = " << quoted(m.source) << "\n";
    const FingerMeshRequest& r = m.mesh;
    out << "elements = " << r.elements << "\n";
    PlainText how;
    how.precision(6);
    if (r.kind == FingerMeshRequest::Kind::conforming)
        how << "kind = \"conforming\", coarse = " << r.grading.coarse << ", bone = " << r.grading.bone << ", ";
    how << "patch = " << r.patch;
    const bool limited = limits_patches(r);
    if (limited)
        how << ", limits = \"" << (r.limits_of == FingerMeshRequest::LimitsOf::regions ? "regions" : "patches") << '"';
    if (r.curved_skin) how << ", skin = \"curved\"";
    if (r.softening > 0) how << ", softening = " << r.softening;
    if (r.limit_softening > 0) how << ", limit_softening = " << r.limit_softening;
    const bool plain = r.kind == FingerMeshRequest::Kind::uniform && r.patch == 0 && !limited && !r.curved_skin &&
                       r.softening == 0 && r.limit_softening == 0;
    if (r.source == FingerMeshRequest::Source::parametric)
        out << "shape = { length_mm = " << r.shape.length / mm << ", width_mm = " << r.shape.width / mm
            << ", thickness_mm = " << r.shape.thickness / mm << ", pad_bulge = " << r.shape.pad_bulge
            << ", nail_drop = " << r.shape.nail_drop << ", crease = " << r.shape.crease << " }\n"
            << (plain ? "" : "mesh = { " + how.str() + " }\n");
    else
        out << "mesh = { " << (r.source == FingerMeshRequest::Source::tets ? "tets" : "surface") << " = "
            << quoted(std::filesystem::absolute(r.file).string())
            << (r.unit.empty() ? "" : ", unit = \"" + r.unit + "\"") << (r.keep_frame ? ", keep_frame = true" : "")
            << orientation_text(r) << (plain ? "" : ", " + how.str()) << " }\n";
    if (!r.bone_nodes.empty()) {
        out << "bone = { nodes = [";
        for (std::size_t i = 0; i < r.bone_nodes.size(); ++i) out << (i ? ", " : "") << r.bone_nodes[i];
        out << "] }\n";
    } else if (r.half_space) {
        out << "bone = { normal = [" << r.half_space_normal[0] << ", " << r.half_space_normal[1] << ", "
            << r.half_space_normal[2] << "], offset_mm = " << r.half_space_offset / mm << " }\n";
    } else {
        out << "bone = { cut = " << r.regions.cut << ", nail = " << r.regions.nail
            << ", phalanx_length = " << r.regions.phalanx_length << ", phalanx_height = " << r.regions.phalanx_height
            << ", phalanx_radius = " << r.regions.phalanx_radius << " }\n";
    }
    out << "material = { kind = \"" << material_names[std::size_t(m.spec.material)]
        << "\", young_kPa = " << m.spec.young_modulus / kPa << ", poisson = " << m.spec.poisson_ratio
        << ", density_kg_per_m3 = " << m.spec.density << " }\n";
    if (m.spec.has_limits) out << "limits = { low = " << m.spec.limit_low << ", high = " << m.spec.limit_high << " }\n";
    for (const TissueLayer& l : m.layers) {
        out << "\n[[layer]]\nthickness_mm = " << l.thickness / mm << "\nyoung_kPa = " << l.young_modulus / kPa;
        if (l.across > 0) out << "\nacross_kPa = " << l.modulus_across() / kPa;
        out << "\nlow = " << l.limit_low << "\nhigh = " << l.limit_high << "\n";
    }
    write_file(path, out.str());
}

}  // namespace palpate
