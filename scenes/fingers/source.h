#pragma once
// Which finger a command is about: a preset, a finger file, a scene's finger, or a mesh.

#include <CLI/CLI.hpp>

#include "scenes/fingers/finger_model.h"

namespace palpate {

struct FingerSource {
    std::string name;    ///< "index-median", "index" (its median), finger.toml, scene.toml, scan.obj, pad.msh
    std::string finger;  ///< which one of a scene
    int elements = 0;    ///< 0: as the finger says
};
/// Adds the options; the finger itself is the one called `option`.
void add_finger_options(CLI::App& command, const std::string& option, const std::string& description,
                        FingerSource& source);

/// Throws InputError.
FingerModel load_finger(const FingerSource& source);

}  // namespace palpate
