#pragma once
// Scenes that are changed while they run: what is checked is where things are now, not where they began.

#include <map>

#include "scenes/load/scene.h"

namespace palpate {

struct PosesNow {
    std::map<std::string, Pose<double>> fingers, objects;  ///< by name; of those that are not new
};

/// As load_scene_text; fingers and objects that `now` knows are built, and checked, where they are now.
Scene load_scene_now(const std::string& text, const std::filesystem::path& file,
                     const std::vector<std::string>& overrides, FingerTemplates* templates, const PosesNow& now);

}  // namespace palpate
