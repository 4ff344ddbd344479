#pragma once
// A finger as a file describes it: shape, material, limits, layers of tissue. Presets are such files.

#include <algorithm>
#include <filesystem>
#include <string>
#include <vector>

#include "engine/build.h"
#include "scenes/load/finger_mesh.h"

namespace palpate {

class Section;
struct Problems;
struct KeyInfo;

/// Words for Material, in its order.
inline const std::vector<std::string> material_names{"corotational", "st-venant-kirchhoff", "neo-hookean"};
/// From here on elements that share no change of volume lock.
inline constexpr double locking_poisson_ratio = 0.45;

/// A layer of tissue below the skin; what lies deeper than all layers has the finger's own material and limits.
struct TissueLayer {
    double thickness = 1e-3;      ///< [m]
    double young_modulus = 80e3;  ///< [Pa]
    double limit_low = 0.6, limit_high = 1.4;
    double across = 0;  ///< Young's modulus across the skin, no more than along it [Pa]; 0: the same

    double modulus_across() const { return across > 0 ? std::min(across, young_modulus) : young_modulus; }
};

struct FingerModel {
    std::string title, source;  ///< what it is, and where its numbers come from
    FingerMeshRequest mesh;
    FingerSpec spec;  ///< all but its mesh
    std::vector<TissueLayer> layers;
};

/// Reads what a finger's table says of itself over what the model holds already: elements, and the tables shape, mesh,
/// bone, material, limits and layer. Files are relative to `folder`.
void read_finger_model(Section& s, const std::filesystem::path& folder, FingerModel& model);
/// How a shape or a surface is meshed: kind, gradings, patches.
void read_how_meshed(Section& s, FingerMeshRequest& request);
void read_material(Section s, FingerSpec& finger);
void read_limits(Section s, FingerSpec& finger);

/// Reads a finger over what the model holds: a preset ("index-median"), or a file if the name ends with .toml.
/// Problems are added.
void read_named_finger(const std::string& name, const std::filesystem::path& folder, FingerModel& model,
                       Problems& problems);
/// All that may stand in a finger file.
KeyInfo finger_file_keys();
/// Names of the presets built in.
std::vector<std::string> finger_preset_names();

/// The finger with its mesh, its layers spread over the elements. Throws InputError.
FingerSpec build_finger(const FingerModel& model, FingerTemplates& templates, std::string& note);
/// What is wrong where layers lie inside their bounds, and what they make of the elements does not; empty: nothing.
std::string too_stiff_a_layer(const FingerModel& model, const FingerSpec& built);
/// Spreads the layers' material over the elements of spec.mesh, by volume.
void apply_layers(const std::vector<TissueLayer>& layers, FingerSpec& spec);

/// Writes a finger file; `comment` lines come first. Throws InputError where it cannot be written.
void write_finger_file(const std::filesystem::path& path, const FingerModel& model,
                       const std::vector<std::string>& comment);

}  // namespace palpate
