#pragma once
// The objects of a scene file, and friction between pairs.

#include "scenes/load/scene.h"
#include "scenes/load/section.h"

namespace palpate {

/// [[object]]: shapes, meshes, bodies, tracks. Files are relative to `folder`.
void read_objects(Section& root, Scene& scene, const std::filesystem::path& folder, FingerTemplates& templates);

/// [[friction]]: the coefficient of two objects, or of a finger and an object, against each other.
void read_pair_frictions(Section& root, Scene& scene);

/// Complains where a name cannot be part of a file's, or is one of the others'.
void check_name(Section& s, const std::string& name, const std::vector<std::string>& others, const char* what);

}  // namespace palpate
