#include "scenes/load/finger_mesh.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <mutex>

#include "meshes/input_error.h"
#include "meshes/mesh_cache.h"
#include "meshes/mesh_files.h"
#include "meshes/patches.h"
#include "meshes/plain_numbers.h"
#include "meshes/tetrahedralise.h"

namespace palpate {

namespace {

/// Limit patches of a finger, whatever its mesh, and the elements that each has at least: what 350 elements have.
struct LimitPatches {
    int count, fewest;
};
/// With patches of volume of more than five elements, fewer: fitted with the presets, whose coarsest mesh otherwise
/// saturates too early.
constexpr LimitPatches limit_patches{70, 5}, larger_limit_patches{25, 14};
/// Faces of skin that share one stretch. Fitted to presses of 0.3 to 2 mm with 350 to 4,000 elements.
constexpr int membrane_patch_size = 8;

void mark_bone(TetMesh& mesh, const FingerMeshRequest& r) {
    if (!r.bone_nodes.empty()) {
        mesh.bone_nodes = r.bone_nodes;
        std::sort(mesh.bone_nodes.begin(), mesh.bone_nodes.end());
        mesh.bone_nodes.erase(std::unique(mesh.bone_nodes.begin(), mesh.bone_nodes.end()), mesh.bone_nodes.end());
        if (mesh.bone_nodes.back() >= int(mesh.nodes.size()))
            throw InputError("bone node " + std::to_string(mesh.bone_nodes.back()) +
                             " does not exist: the mesh has nodes 0 to " + std::to_string(mesh.nodes.size() - 1));
        mark_pad(mesh);
    } else if (r.half_space) {
        mark_half_space(mesh, r.half_space_normal, r.half_space_offset);
    } else {
        mark_regions(mesh, r.regions);
    }
}

/// Tetrahedra inside a surface in the finger frame.
TetMesh filled(const FingerMeshRequest& r, const Surface& surface, std::string& note) {
    if (r.kind == FingerMeshRequest::Kind::conforming) {
        const FingerRegions regions = r.regions == FingerRegions{} ? fitted_phalanx(surface, r.regions) : r.regions;
        if (!(regions == r.regions)) {
            const auto box = bounds(surface.vertices);
            char text[120];
            plain_snprintf(text, sizeof text, ", phalanx narrowed to a radius of %.2f mm (phalanx_radius %.3g)",
                           1e3 * regions.phalanx_radius * (box[1][2] - box[0][2]), regions.phalanx_radius);
            note += text;
        }
        MeshKey key("conforming");
        key.add(surface).add(r.elements).add(r.grading.coarse).add(r.grading.bone);
        for (double x :
             {regions.cut, regions.nail, regions.phalanx_length, regions.phalanx_height, regions.phalanx_radius})
            key.add(x);
        return made_once(key, [&] { return conforming_mesh(surface, regions, r.grading, {.elements = r.elements}); });
    }
    return made_once(MeshKey("uniform").add(surface).add(r.elements),
                     [&] { return tetrahedralise(surface, {.elements = r.elements}); });
}

/// The mesh whose limit patches all finer ones of the finger have: the default finger's.
constexpr int base_elements = 347, least_finer = 380;

/// Patches of what shares its change of volume, its strain limits, its stretch along the skin; of templates once.
/// `base` makes the finger's mesh of `base_elements`, grouped; where there is none (a scan that cannot be meshed with
/// so few), and of meshes whose bone is not a surface, patches of limits are the mesh's own.
template <class Base>
void group_elements(TetMesh& mesh, const FingerMeshRequest& r, Base base) {
    if (r.patch > 0 && mesh.patches.empty()) make_patches(mesh, r.patch);
    if (limits_patches(r) && mesh.limit_patches.empty()) {
        if (r.kind == FingerMeshRequest::Kind::conforming && r.elements >= least_finer) try {
                if (r.limits_of == FingerMeshRequest::LimitsOf::regions)
                    cut_limit_patches(mesh, base());
                else
                    take_limit_patches(mesh, base());
            } catch (const InputError&) { mesh.limit_patches.clear(), mesh.limit_shares.clear(); }
        const LimitPatches wanted = r.patch > 5 ? larger_limit_patches : limit_patches;
        if (mesh.limit_patches.empty()) make_limit_patches(mesh, wanted.count, wanted.fewest);
    }
    if (r.patch > 0 && r.layered && mesh.membrane_patches.empty()) make_membrane_patches(mesh, membrane_patch_size);
}

FingerMeshRequest base_of(FingerMeshRequest r) {
    r.elements = base_elements;
    return r;
}

/// What a template is made of, in full.
std::string template_key(const FingerMeshRequest& r, double nail_drop) {
    std::string key = std::to_string(r.elements) + " " + std::to_string(r.patch) + " " +
                      std::to_string(int(r.limits_of.value_or(FingerMeshRequest::LimitsOf::elements))) + " " +
                      std::to_string(r.layered);
    const auto add = [&](double x) {
        char text[40];
        plain_snprintf(text, sizeof text, " %.17g", x);
        key += text;
    };
    add(nail_drop);
    if (r.kind == FingerMeshRequest::Kind::conforming)
        for (double x : {r.regions.cut, r.regions.nail, r.regions.phalanx_length, r.regions.phalanx_height,
                         r.regions.phalanx_radius, r.grading.coarse, r.grading.bone})
            add(x);
    return key;
}

/// Of the templates that were made last, copies are kept for the scenes that this process loads next.
TetMesh kept_or_made(const std::string& key, const FingerMeshRequest& r, const FingerShape& shape, std::string& note) {
    struct Kept {
        TetMesh mesh;
        std::string note;
    };
    static std::mutex mutex;
    static std::map<std::string, Kept> all;
    {
        const std::lock_guard lock(mutex);
        if (const auto it = all.find(key); it != all.end()) return note += it->second.note, it->second.mesh;
    }
    Kept made;
    made.mesh = filled(r, finger_surface(shape), made.note);
    // Of all sizes alike.
    group_elements(made.mesh, r, [&] {
        const FingerMeshRequest base = base_of(r);
        std::string of_base;
        return kept_or_made(template_key(base, shape.nail_drop), base, shape, of_base);
    });
    const std::lock_guard lock(mutex);
    if (all.size() >= 8) all.clear();
    return note += made.note, (all[key] = std::move(made)).mesh;
}

TetMesh parametric(const FingerMeshRequest& r, FingerTemplates& templates, std::string& note) {
    FingerShape shape = finger_shape("middle");
    shape.nail_drop = r.shape.nail_drop;
    if (const auto wrong = r.shape.validate(); !wrong.empty()) throw InputError(wrong);
    const std::string key = template_key(r, shape.nail_drop);
    auto it = templates.find(key);
    if (it == templates.end()) it = templates.emplace(key, kept_or_made(key, r, shape, note)).first;
    TetMesh mesh = it->second;
    for (Point& p : mesh.nodes) {
        p[0] *= r.shape.length / shape.length;
        p[1] *= r.shape.width / shape.width;
        p[2] *= r.shape.thickness / shape.thickness;
    }
    return mesh;
}

/// The surface in the finger frame, as the request says or as it is guessed.
Surface oriented(const FingerMeshRequest& r, const Surface& surface, std::string& note) {
    if (r.keep_frame) return surface;
    if (r.orientation) return turn_to_finger_frame(surface, *r.orientation);
    const OrientationGuess guess = guess_orientation(surface);
    note += ", " + describe(guess);
    if (guess.confidence < least_orientation_confidence) {
        char text[300];
        plain_snprintf(
            text, sizeof text,
            ": how it lies is not certain (confidence %.2f, needed: %.2f; least sure: %s). Say it: mesh = { "
            "surface = \"...\", orientation = { tip = [%.2g, %.2g, %.2g], dorsal = [%.2g, %.2g, %.2g] } } is "
            "the guess; `palpate mesh FILE --picture out.svg` shows it",
            guess.confidence, least_orientation_confidence, guess.doubt.c_str(), guess.orientation.tip[0],
            guess.orientation.tip[1], guess.orientation.tip[2], guess.orientation.dorsal[0],
            guess.orientation.dorsal[1], guess.orientation.dorsal[2]);
        throw InputError(r.file + text);
    }
    return turn_to_finger_frame(surface, guess.orientation);
}

}  // namespace

double softened_by(double softening, std::size_t elements) {
    return 1 + softening * std::pow(double(base_elements) / double(elements), 2.0 / 3);
}

TetMesh make_finger_mesh(const FingerMeshRequest& r, FingerTemplates& templates, std::string& note) {
    TetMesh mesh;
    Surface skin;  // of a scan
    if (r.source == FingerMeshRequest::Source::parametric) {
        note = "parametric finger";
        mesh = parametric(r, templates, note);
    } else if (r.source == FingerMeshRequest::Source::tets) {
        mesh = read_tet_mesh(r.file, r.unit.empty() ? "mm" : r.unit);
        note = r.file + " in " + (r.unit.empty() ? "mm" : r.unit);
    } else {
        const SurfaceFile file = read_surface(r.file, r.unit);
        note = r.file + " in " + file.unit + (file.unit_was_guessed ? " (guessed)" : "");
        skin = oriented(r, file.surface, note);
        mesh = filled(r, skin, note);
    }
    const bool has_bone = r.kind == FingerMeshRequest::Kind::conforming && r.source != FingerMeshRequest::Source::tets;
    if (!has_bone) mark_bone(mesh, r);
    if (r.source == FingerMeshRequest::Source::parametric) {
        FingerShape made = r.shape;  // with the pad of the template, for which the regions are meant
        made.pad_bulge = FingerShape{}.pad_bulge, made.crease = FingerShape{}.crease;
        change_pad(mesh.nodes, made, r.shape);
    }
    group_elements(mesh, r, [&] {
        if (skin.vertices.empty()) throw InputError("a finished mesh has no other");
        const FingerMeshRequest base = base_of(r);
        std::string of_base;
        TetMesh coarse = filled(base, skin, of_base);
        group_elements(coarse, base, [&] { return coarse; });
        return coarse;
    });
    mesh.curved_skin = r.curved_skin;
    note += ": " + std::to_string(mesh.tets.size()) + " tetrahedra, " + std::to_string(mesh.nodes.size()) + " nodes, " +
            std::to_string(mesh.pad_nodes.size()) + " pad nodes, " + std::to_string(mesh.bone_nodes.size()) +
            " bone nodes";
    return mesh;
}

}  // namespace palpate
