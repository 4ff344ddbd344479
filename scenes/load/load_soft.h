#pragma once
// Objects of tissue (soft = { ... }), and what they are filled with.

#include "scenes/load/scene.h"

namespace palpate {

class Section;

/// Reads what an object's table says of its tissue, and meshes it in its shape, which is sound. Problems are the
/// section's. `surface_file` is that of a mesh.
void read_soft(Section& object, bool shaped, const std::string& surface_file, const std::string& unit,
               FingerTemplates& templates, ObjectSpec& spec);

}  // namespace palpate
