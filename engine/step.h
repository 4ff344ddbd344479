#pragma once
// The step of the simulation.

#include "engine/threads.h"
#include "engine/world.h"

namespace palpate {

/// Advances the world by world.solver.dt, on these threads. The result does not depend on how
/// many there are. Nothing is allocated but by oneTBB (tasks) and NLopt (SLSQP's workspace).
void step(World& world, Threads& threads);

}  // namespace palpate
