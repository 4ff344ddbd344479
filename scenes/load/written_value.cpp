#include "scenes/load/written_value.h"

#include <nlohmann/json.hpp>

namespace palpate {

nlohmann::ordered_json written_value(const std::string& text) { return nlohmann::ordered_json::parse(text); }

}  // namespace palpate
