#pragma once
// A key's default as a value. In a source of its own: a parser takes the compiler as long as all that reads it.

#include <nlohmann/json_fwd.hpp>
#include <string>

namespace palpate {

/// Of what is written as in JSON: numbers, words in quotes, truths, lists.
nlohmann::ordered_json written_value(const std::string& text);

}  // namespace palpate
