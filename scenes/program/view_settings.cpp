#include "scenes/program/view_settings.h"

#include <algorithm>
#include <cctype>
#include <nlohmann/json.hpp>
#include <sstream>

#include "meshes/mesh_files.h"
#include "scenes/viewer/report.h"

namespace palpate {

namespace {

/// Whether one of the lines sets a key, here `key = ...` or there `table.key=...`; comments apart.
bool sets_key(const std::string& text, const std::string& key) {
    std::istringstream lines(text);
    for (std::string line; std::getline(lines, line);) {
        line.resize(std::min(line.size(), line.find('#')));
        for (std::size_t at = line.find(key); at != std::string::npos; at = line.find(key, at + 1)) {
            const std::size_t after = line.find_first_not_of(" \t", at + key.size());
            const bool begins =
                at == 0 || !(std::isalnum(static_cast<unsigned char>(line[at - 1])) || line[at - 1] == '_');
            if (begins && after != std::string::npos && line[after] == '=') return true;
        }
    }
    return false;
}

}  // namespace

nlohmann::json settings_of(const Scene& scene) {
    nlohmann::json out = nlohmann::json::array();
    auto add = [&](const std::string& label, std::vector<std::string> keys, double min, double max, double step,
                   double value) {
        out.push_back({{"label", label},
                       {"keys", std::move(keys)},
                       {"min", min},
                       {"max", max},
                       {"step", step},
                       {"value", value}});
    };
    std::vector<std::string> young, low, high;
    bool limits = false;
    for (const FingerSpec& f : scene.spec.fingers) {
        young.push_back("finger." + f.name + ".material.young_kPa");
        limits |= f.has_limits;
    }
    add("Young's modulus, kPa", young, 5, 200, 1, scene.spec.fingers[0].young_modulus / 1e3);
    if (limits) {
        add("stretch at least", {"limits.low"}, 0.3, 0.98, 0.01, scene.spec.fingers[0].limit_low);
        add("stretch at most", {"limits.high"}, 1.02, 2, 0.01, scene.spec.fingers[0].limit_high);
    }
    for (const ObjectSpec& o : scene.spec.objects)
        if (o.friction > 0) add("friction, " + o.name, {"object." + o.name + ".friction"}, 0, 2, 0.05, o.friction);
    std::vector<std::string> methods;
    for (const ThimbleSpec& t : scene.spec.thimbles)
        methods.push_back("finger." + scene.spec.fingers[std::size_t(t.finger)].name + ".device.method");
    const std::vector<std::string> choices{"constrained", "unconstrained", "plane", "force"};  // as MatchingMethod
    if (!methods.empty())
        out.push_back({{"label", "matching method"},
                       {"keys", methods},
                       {"choices", choices},
                       {"value", choices[std::size_t(scene.spec.thimbles[0].method)]}});
    add("Newton iterations", {"solver.newton_iterations"}, 1, 20, 1, std::min(20, scene.spec.solver.newton_iterations));
    return out;
}

bool names_preset(const Scene& scene, const std::vector<std::string>& overrides) {
    std::string text = read_file(scene.file);
    for (const std::string& o : overrides) text += "\n" + o;
    if (scene.deadline > 0) return true;
    return sets_key(text, "preset") || sets_key(text, "deadline_ms") || sets_key(text, "static");
}

std::string live_page(const std::string& scene_text, const nlohmann::json& settings, const nlohmann::json& model) {
    return page_with({{"live", true},
                      {"about", "live"},
                      {"summary", ""},
                      {"scene", scene_text},
                      {"settings", settings},
                      {"model", model}});
}

nlohmann::json message_of(const char* word, const std::string& now) { return {{word, now}}; }

}  // namespace palpate
