#include "scenes/run/wrapped.h"

#include <cstdarg>
#include <cstdio>
#include <sstream>

#include "meshes/plain_numbers.h"

namespace palpate {

std::string wrapped(const std::string& sentence, const std::string& indent) {
    std::string out, line = indent, word;
    bool first = true;
    for (std::istringstream words(sentence); words >> word; first = false) {
        if (!first && line.size() + 1 + word.size() > terminal_columns - 1) {
            out += line + "\n";
            line = indent + "  " + word;
        } else {
            line += (first ? "" : " ") + word;
        }
    }
    return out + line + "\n";
}

std::string written(const char* format, ...) {
    std::va_list values, again;
    va_start(values, format);
    va_copy(again, values);
    std::string out(std::size_t(plain_vsnprintf(nullptr, 0, format, values)), '\0');
    plain_vsnprintf(out.data(), out.size() + 1, format, again);
    va_end(again);
    va_end(values);
    return out;
}

}  // namespace palpate
