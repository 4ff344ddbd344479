#pragma once
// The mesh of a scene's finger: parametric, from a surface, or finished.

#include <map>
#include <optional>
#include <string>

#include "meshes/conforming_mesh.h"
#include "meshes/finger_orientation.h"
#include "meshes/finger_regions.h"
#include "meshes/finger_shape.h"

namespace palpate {

/// Of built-in fingers with conforming meshes (usual_crease). Of the template's meshes of 335 to 545 elements, that for
/// 400 is as good as those of 500 in nearly all that was measured (bench/README.md, "Meshes").
inline constexpr int usual_elements = 400;
/// Of theirs, so that they press as the finest meshes do: 2 to 4 % less.
inline constexpr double usual_softening = 0.04;

struct FingerMeshRequest {
    enum class Source { parametric, surface, tets } source = Source::parametric;
    FingerShape shape;
    std::string file, unit;
    bool keep_frame = false;                         ///< the file's axes are the finger frame already
    std::optional<FingerOrientation> orientation{};  ///< of the file; absent: guessed
    int elements = 347;
    enum class Kind { uniform, conforming } kind = Kind::uniform;  ///< of a parametric finger or a surface
    int patch = 0;  ///< elements that share one change of volume; 0: none do
    /// Whose stretches strain limits hold: tetrahedra's, those of patches of whole tetrahedra, or of patches with
    /// bounds that are the same in every mesh, and cut tetrahedra.
    enum class LimitsOf { elements, patches, regions };
    std::optional<LimitsOf> limits_of{};  ///< absent: as usual
    bool curved_skin = false;             ///< contact is decided on a skin that is round between nodes
    double softening = 0;                 ///< of coarse meshes, which press too hard (softened_by)
    double limit_softening = 0;           ///< of their lower limits, which they reach too early
    bool layered = false;                 ///< has a skin: with patches of elements, patches of skin, too
    bool by_default = false;              ///< kind and patch are those of scenes that say nothing of them
    std::optional<int> scene_patch{};     ///< what the scene says of all fingers' patches
    bool own_patch = false;               ///< the finger itself says it
    /// Of a shape with a conforming mesh, where nothing is said of them.
    struct Usual {
        int elements = 347;
        double crease = 0, softening = 0;
    } usual;
    bool own_elements = false, own_crease = false, own_softening = false;  ///< said
    Grading grading;                                                       ///< of a conforming mesh
    FingerRegions regions;
    bool half_space = false;  ///< bone nodes by half-space instead of regions
    Point half_space_normal{0, 0, 1};
    double half_space_offset = 0;  ///< [m]
    std::vector<int> bone_nodes;   ///< bone nodes by list, if not empty
};

/// Templates of parametric fingers: fingers that differ in length, width, thickness and pad bulge only are one
/// template, scaled, so that they share their connectivity (and with it chunks).
using FingerTemplates = std::map<std::string, TetMesh>;

/// By how much moduli are divided: 1 + softening (347 / elements)^(2/3). What a mesh presses too hard goes with the
/// area of its elements, as errors of linear elements do.
double softened_by(double softening, std::size_t elements);

/// Whether strain limits are of patches of some kind.
inline bool limits_patches(const FingerMeshRequest& r) {
    return r.limits_of.value_or(FingerMeshRequest::LimitsOf::elements) != FingerMeshRequest::LimitsOf::elements;
}

/// Builds the mesh and says in `note` what was built and guessed. Throws InputError.
TetMesh make_finger_mesh(const FingerMeshRequest& request, FingerTemplates& templates, std::string& note);

}  // namespace palpate
