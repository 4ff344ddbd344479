#pragma once
// Which finger a command is about: a preset, a finger file, a scene's finger, or a mesh.

#include "scenes/load/finger_model.h"
#include "scenes/program/options.h"

namespace palpate {

struct FingerSource {
    std::string name;    ///< "index-median", "index" (its median), finger.toml, scene.toml, scan.obj, pad.msh
    std::string finger;  ///< which one of a scene
    int elements = 0;    ///< 0: as the finger says
};
/// Adds the options, and returns that of the finger itself, called `option`.
Option add_finger_options(const Command& command, const std::string& option, const std::string& description,
                          FingerSource& source);

/// Throws InputError.
FingerModel load_finger(const FingerSource& source);

}  // namespace palpate
