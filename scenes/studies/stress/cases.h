#pragma once
// What the cases share: fingers above a table, and looks at how they are.

#include "engine/build.h"
#include "engine/step.h"
#include "scenes/studies/stress/stress.h"

namespace palpate::stress {

/// printf into a string.
[[gnu::format(printf, 1, 2)]] std::string text(const char* format, ...);

/// A finger above a table, pad down; its lowest node at `height` [m].
SceneSpec press_spec(int elements, double height = 0.0005);
/// Tells a finger's tracker where it is.
void aim(World& world, std::size_t finger, const Pose<double>& pose);

bool finite(const World& world);
/// Of the first finger: farthest node from its rest place on the bone, as a share of the finger's extent.
double off_rest(const World& world);
int inverted_elements(const World& world);

// The cases, by their names in the table of stress.cpp.
StressOutcome start_states(int effort, const std::atomic<bool>& stop);
StressOutcome deformation_gradients(int effort, const std::atomic<bool>& stop);
StressOutcome slivers(int effort, const std::atomic<bool>& stop);
StressOutcome material_grid(int effort, const std::atomic<bool>& stop);
StressOutcome unlike_neighbours(int effort, const std::atomic<bool>& stop);
StressOutcome heavy_press(int effort, const std::atomic<bool>& stop);
StressOutcome heavy_blow(int effort, const std::atomic<bool>& stop);
StressOutcome tight_limits(int effort, const std::atomic<bool>& stop);
StressOutcome contacts(int effort, const std::atomic<bool>& stop);
StressOutcome friction_ends(int effort, const std::atomic<bool>& stop);
StressOutcome tracker_faults(int effort, const std::atomic<bool>& stop);
StressOutcome hard_matches(int effort, const std::atomic<bool>& stop);
StressOutcome soak(int effort, const std::atomic<bool>& stop);
StressOutcome determinism(int effort, const std::atomic<bool>& stop);
StressOutcome one_finger_lost(int effort, const std::atomic<bool>& stop);

}  // namespace palpate::stress
