#pragma once
// What lies inside what before the first step.

#include "scenes/load/load_now.h"
#include "scenes/load/section.h"

namespace palpate {

/// Depths at which the start of a scene is said, or refused [m]. A finger is refused where it is deeper than half its
/// own thickness: so deep its bone would be.
inline constexpr double finger_depth_said = 1e-3, body_depth_said = 1e-4, body_depth_refused = 2e-3;

/// Warns of fingers that start inside objects or each other, and of bodies that start inside objects, by their names;
/// refuses those so deep that what follows would be no contact. Fixed objects may overlap. Two that `now` knows press
/// each other as they have come to: nothing is said of them.
void check_start(const Scene& scene, Problems& problems, const PosesNow* now = nullptr);

/// How deep a finger's pad lies in an object at the start [m]; not above 0 where it does not touch.
double start_depth(const FingerSpec& finger, const ObjectSpec& object);
/// How deep points of two objects lie in each other at the start [m].
double start_depth(const ObjectSpec& a, const ObjectSpec& b);
/// How deep one finger's pad lies in another finger at the start [m].
double start_depth(const FingerSpec& a, const FingerSpec& b);

}  // namespace palpate
