#pragma once
// Scenes that nothing was chosen by.

#include <string>

namespace palpate {

/// The text of a scene: a finger of a random size and tissue, pressed on and moved over a random object; the same for
/// the same number.
std::string generated_scene(unsigned number);

}  // namespace palpate
