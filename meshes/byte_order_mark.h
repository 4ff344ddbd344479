#pragma once
// Text files of some programs ("CSV UTF-8", Notepad) begin with a mark of three bytes, which is no text.

#include <istream>
#include <string_view>

namespace palpate {

inline constexpr std::string_view byte_order_mark = "\xef\xbb\xbf";

/// Steps over the mark where a file begins with one.
inline void skip_byte_order_mark(std::istream& in) {
    char head[3] = {};
    in.read(head, sizeof head);
    if (std::string_view(head, sizeof head) == byte_order_mark) return;
    in.clear();
    in.seekg(0);
}

/// A file's text without the mark.
inline std::string_view without_byte_order_mark(std::string_view text) {
    return text.starts_with(byte_order_mark) ? text.substr(byte_order_mark.size()) : text;
}

}  // namespace palpate
