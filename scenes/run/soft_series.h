#pragma once
// What becomes of objects of tissue over a run: a row per step.

#include "scenes/run/simulation.h"

namespace palpate {

std::vector<std::string> soft_columns();
/// Appends a row per soft object to the simulation's series.
void record_soft_objects(Simulation& simulation);
/// How far an object's surface is from where it was at rest, at most [m].
double deepest_dent(const World& world, const SoftObject& object);
/// Whether the last step of its solve has converged.
bool has_converged(const World& world, const SoftObject& object);

}  // namespace palpate
