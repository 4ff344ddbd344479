#pragma once

#include "scenes/studies/random/random_blocks.h"

namespace palpate {

/// Grasps that are lifted, moved and turned; things of meshes on each other, on what moves, and in each other at the
/// start; bodies that fly; fingers that press firmly and come back. Sets how long the scene is and its step.
void draw_handled(Random& r, RandomScene& s, int fingers);

/// A coupling from loose to 10,000 N/mm, that draws with much or little force.
Block any_coupling(Random& r);

}  // namespace palpate
