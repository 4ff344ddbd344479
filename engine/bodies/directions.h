#pragma once
// Newton directions of islands: lanes, bodies, planes between fingers, and what soft objects couple.

#include "engine/bodies/islands.h"

namespace palpate {

/// Finds the direction of every island that takes a Newton step, and its slope.
void find_directions(BodyWork& work);

}  // namespace palpate
