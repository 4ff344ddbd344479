#pragma once
// [solver] of a scene file.

#include "scenes/load/scene.h"
#include "scenes/load/section.h"

namespace palpate {

/// Settings of the solve, over those of its preset. Sets the precision of the scene's fingers.
void read_solver(Section s, Scene& scene);

}  // namespace palpate
