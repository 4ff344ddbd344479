#pragma once
// Laws of bodies: what moves them, and where they may be.

#include "scenes/studies/random/watched.h"

namespace palpate {

/// Where bodies are and how they move, after a step.
void see_bodies(Watched& watched);

/// A body that nothing touches falls with gravity, keeps its angular momentum, turns as that says, and gains no energy.
void check_flight(Watched& watched, Findings& found);

/// What a body's momentum and angular momentum change by is what its contacts and its weight give it, where it has
/// converged and is held by fingers that it does not slide over.
void check_motion(const Watched& watched, Findings& found);

/// How deep objects lie in each other, before the first step and after every one; after check_motion, which asks for
/// how deep they did before.
void see_overlaps(Watched& watched);

/// An overlap of objects is undone at the recovery speed.
void check_overlaps(const Watched& watched, Findings& found);

/// What bodies may gain of height where overlaps are undone [J].
double lifted_by_overlaps(const Watched& watched);

/// A body that fingers hold with friction to spare is not dropped.
void check_drops(const Simulation& simulation, Findings& found);

}  // namespace palpate
