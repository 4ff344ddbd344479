#pragma once
// What can be set while a scene is viewed.

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "scenes/load/scene.h"

namespace palpate {

/// The scene's main settings: label, the keys they change, range (a slider) or choices, and value now.
nlohmann::json settings_of(const Scene& scene);
/// Whether a scene or an override says itself which preset runs: a preset or a deadline is set.
bool names_preset(const Scene& scene, const std::vector<std::string>& overrides);

/// The page of a live run: the scene's text, settings_of() it, and page_model() of what runs.
std::string live_page(const std::string& scene_text, const nlohmann::json& settings, const nlohmann::json& model);
/// What the page is told: one word, and what it is now.
nlohmann::json message_of(const char* word, const std::string& now);

}  // namespace palpate
