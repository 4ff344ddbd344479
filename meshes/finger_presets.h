#pragma once
// The finger files of meshes/fingers, built in.

#include <string_view>
#include <vector>

namespace palpate {

struct FingerPreset {
    std::string_view name;  ///< "index-median"
    std::string_view text;  ///< TOML
};
const std::vector<FingerPreset>& finger_presets();

}  // namespace palpate
