#pragma once
// Numbers as text, the same in every country. A program that embeds this may have set a locale whose decimal point is a
// comma (GTK, Qt and LabVIEW set the user's), and C and C++ would write and read numbers as that says: in switches of
// the mesher, in scenes, in files. Needs nothing but headers; programs of our own never set a locale.

#include <locale.h>

#include <cstdarg>
#include <cstdio>
#include <cstdlib>
#include <locale>
#include <sstream>
#include <string>

namespace palpate {

/// While it lives, the C library's functions write and read numbers in this thread as they do in the "C" locale.
class PlainNumbers {
  public:
    PlainNumbers() : before_(uselocale(plain())) {}
    ~PlainNumbers() { uselocale(before_); }
    PlainNumbers(const PlainNumbers&) = delete;
    PlainNumbers& operator=(const PlainNumbers&) = delete;

  private:
    static locale_t plain() {
        static const locale_t c = newlocale(LC_ALL_MASK, "C", locale_t{});
        return c;
    }
    locale_t before_;
};

/// std::vsnprintf in the "C" locale.
[[gnu::format(printf, 3, 0)]] inline int plain_vsnprintf(char* text, std::size_t size, const char* format,
                                                         std::va_list values) {
    const PlainNumbers plain;
    return std::vsnprintf(text, size, format, values);
}

/// std::snprintf in the "C" locale.
[[gnu::format(printf, 3, 4)]] inline int plain_snprintf(char* text, std::size_t size, const char* format, ...) {
    std::va_list values;
    va_start(values, format);
    const int length = plain_vsnprintf(text, size, format, values);
    va_end(values);
    return length;
}

/// std::strtod in the "C" locale.
inline double plain_strtod(const char* text, char** end) {
    const PlainNumbers plain;
    return std::strtod(text, end);
}

/// std::strtof in the "C" locale.
inline float plain_strtof(const char* text, char** end) {
    const PlainNumbers plain;
    return std::strtof(text, end);
}

/// std::to_string of a number that is no integer, in the "C" locale.
inline std::string plain_to_string(double value) {
    const PlainNumbers plain;
    return std::to_string(value);
}

/// A stream of text in the "C" locale, whatever C++'s global one is: that would also part thousands.
class PlainText : public std::ostringstream {
  public:
    PlainText() { imbue(std::locale::classic()); }
};

}  // namespace palpate
