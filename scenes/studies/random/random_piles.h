#pragma once
// What lies, flies, is carried, or begins overlapping.

#include "scenes/studies/random/random_blocks.h"

namespace palpate {

/// Any solid or mesh whose lowest point is at z = 0 once it is placed by half its height; a scene has one mesh, which
/// more than one of its things may be.
Solid any_solid(Random& r, RandomScene& s, double smallest, double largest);

/// One to three bodies on each other, bars across bars, cubes, plates, on a plane, box or mesh. Returns the top [mm].
double draw_stack(Random& r, RandomScene& s);

/// Bodies on a tray that moves and tilts.
void draw_carried(Random& r, RandomScene& s, double duration);

/// Bodies that touch nothing.
void draw_flight(Random& r, RandomScene& s);

/// Bodies that begin in each other, by as much as load lets them, beside or on each other.
void draw_overlap(Random& r, RandomScene& s);

}  // namespace palpate
