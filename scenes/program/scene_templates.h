#pragma once
// The files of scenes/templates, built in.

#include <string_view>
#include <vector>

namespace palpate {

struct SceneTemplate {
    std::string_view name;  ///< "press"
    std::string_view text;  ///< TOML
};
const std::vector<SceneTemplate>& scene_templates();

}  // namespace palpate
