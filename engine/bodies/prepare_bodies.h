#pragma once
// Memory of what bodies and fingers that touch each other are solved with, from the start.

#include "engine/build.h"

namespace palpate {

/// Everything the bodies' solve needs, so that nothing is allocated later.
void prepare_bodies(World& world);

/// Memory for finding which fingers are near each other, and of a few for touching. Before there are chunks of soft
/// objects, which touch no finger as fingers do.
void prepare_finger_pairs(const SceneSpec& spec, World& world);

/// And for solving those that touch; after prepare_bodies.
void prepare_touching_fingers(World& world);

}  // namespace palpate
