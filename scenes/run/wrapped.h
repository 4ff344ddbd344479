#pragma once
// Sentences for a terminal of 80 columns.

#include <string>

namespace palpate {

inline constexpr std::size_t terminal_columns = 80;
/// A sentence in lines that fit a terminal, ended by a newline; `indent` before the first, two more spaces before
/// others.
std::string wrapped(const std::string& sentence, const std::string& indent = "");
/// As printf would write it.
[[gnu::format(printf, 1, 2)]] std::string written(const char* format, ...);

}  // namespace palpate
