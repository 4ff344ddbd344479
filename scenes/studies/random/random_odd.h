#pragma once

#include "scenes/studies/random/random_blocks.h"

namespace palpate {

/// Any fingers from any side on a body that is a mesh, flies and spins, is pushed, or lies on tissue. `dt`: what their
/// motions take some of [s].
void draw_odd(Random& r, RandomScene& s, int fingers, double dt);

}  // namespace palpate
