#pragma once
// Settings that change while a scene runs: a simulation with the new ones goes on where the old one was.

#include "scenes/run/simulation.h"

namespace palpate {

/// Gives `to`, just made from the same scene with other settings, the state of `from`: time, hands, skins, bodies,
/// thimbles, and the loops and controllers that drive them, which go on without a break. Objects that nothing moves are
/// where the settings put them, if that has changed; what forces move is where it was. False, and nothing has
/// changed, where the two are not built alike (other meshes, objects or thimbles).
bool carry_over(Simulation& from, Simulation& to);

}  // namespace palpate
