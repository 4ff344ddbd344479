#pragma once
// Laws of fingers, their bones and what draws these, in every step that has converged.

#include "scenes/studies/random/watched.h"

namespace palpate {

/// The coupling draws and turns a bone no harder than it may: what the bone moves with, less what its skin and the
/// damper give it.
void check_coupling(const Watched& watched, Findings& found);

/// A bone that nothing holds comes to its tracked pose, where that stands still for long enough.
void check_free_bones(Watched& watched, Findings& found);

/// Coefficient of a finger against an object.
double friction_between(const Simulation& simulation, std::size_t finger, std::size_t object);

/// Friction of a finger on an object is no more than Coulomb's law allows for the scene's coefficient.
void check_friction(const Watched& watched, Findings& found);

/// Whether a finger presses on an object with friction to spare; and whether it did in the step before, as hard: what
/// has only just come to touch slid before it did.
bool sticks(const ObjectContact& contact);
bool stuck_before(const FingerState& before, const ObjectContact& now);

}  // namespace palpate
