#pragma once
// From a scene that breaks a law to a small one that still does.

#include <functional>

#include "scenes/studies/random/random_scene.h"

namespace palpate {

/// Leaves out tables, then lines, for as long as `still_fails` says that the law is still broken; at most `tries`
/// calls.
RandomScene shrink_scene(RandomScene scene, const std::function<bool(const RandomScene&)>& still_fails, int tries = 60);

}  // namespace palpate
