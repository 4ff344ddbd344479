#pragma once
// The step of the simulation.

#include <oneapi/tbb/task_arena.h>

#include "engine/world.h"

namespace palpate {

/// Advances the world by world.solver.dt, on the arena's threads. The result does not depend on how
/// many there are. Nothing is allocated but by oneTBB (tasks) and NLopt (SLSQP's workspace).
void step(World& world, oneapi::tbb::task_arena& arena);

}  // namespace palpate
