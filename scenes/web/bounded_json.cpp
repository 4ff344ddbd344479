#include "scenes/web/bounded_json.h"

#include <nlohmann/json.hpp>

namespace palpate {

std::string beyond_bounds(std::string_view text, const JsonBounds& bounds) {
    if (text.size() > bounds.size) return "a message of more than " + std::to_string(bounds.size >> 10) + " kB";
    bool in_string = false, escaped = false;
    int depth = 0;
    for (const char c : text) {
        if (in_string) {
            if (!escaped && c == '"') in_string = false;
            escaped = !escaped && c == '\\';
        } else if (c == '"') {
            in_string = true;
        } else if (c == '[' || c == '{') {
            if (++depth > bounds.depth) return "a message nested more than " + std::to_string(bounds.depth) + " deep";
        } else if (c == ']' || c == '}') {
            --depth;
        }
    }
    return "";
}

nlohmann::json parse_object(std::string_view text, std::string& wrong, const JsonBounds& bounds) {
    wrong = beyond_bounds(text, bounds);
    if (!wrong.empty()) return nlohmann::json(nlohmann::json::value_t::discarded);
    auto json = nlohmann::json::parse(text, nullptr, false);
    if (json.is_object()) return json;
    wrong = "expected a JSON object";
    return nlohmann::json(nlohmann::json::value_t::discarded);
}

std::string shown(const nlohmann::json& value) {
    return value.dump(-1, ' ', true, nlohmann::json::error_handler_t::replace).substr(0, 40);
}

}  // namespace palpate
