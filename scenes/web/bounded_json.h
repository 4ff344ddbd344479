#pragma once
// JSON from outside: messages of trackers and pages, lines of recordings. Depth and size are bounded before any of it
// is parsed: what is parsed is small, and whatever walks through it recursively is safe.

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>

namespace palpate {

struct JsonBounds {
    std::size_t size = 65536;  ///< of the text [bytes]
    int depth = 16;            ///< arrays and objects within each other; frames of a Leap Motion service have six
};

/// Of files that this program has written, or so it seems.
inline constexpr JsonBounds file_bounds{std::size_t(1) << 28, 16};

/// Why a text is not parsed: it is too long, or too deep; empty if it is neither. One pass without recursion; what is
/// no JSON may pass.
std::string beyond_bounds(std::string_view text, const JsonBounds& bounds = {});

/// The object that a text holds. Where it is none, or is out of bounds, `wrong` says so and the result is discarded.
nlohmann::json parse_object(std::string_view text, std::string& wrong, const JsonBounds& bounds = {});

/// A value in a message for a person: at most 40 characters, ASCII without control characters, whatever it holds.
std::string shown(const nlohmann::json& value);

}  // namespace palpate
