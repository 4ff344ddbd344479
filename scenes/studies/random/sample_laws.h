#pragma once
// Laws of single points of the skin, in every step that has converged: what a finger reports as a whole does not say
// what each of them does.

#include "scenes/studies/random/watched.h"

namespace palpate {

/// What a finger presses on an object with, and has friction to spare there, moves with the object.
void check_slips(const Watched& watched, Findings& found);

/// Skin that was outside an object is not on its other side a step later.
void check_leaps(const Watched& watched, Findings& found);

}  // namespace palpate
