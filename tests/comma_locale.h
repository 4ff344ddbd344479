#pragma once
// A host whose decimal point is a comma: the C library's locale, where one can be had, and the global one of C++.

#include <stdlib.h>

#include <clocale>
#include <filesystem>
#include <locale>
#include <string>

namespace palpate::testing {

/// While it lives, printf writes 0,5 and streams write 1.000,5. Machines without such a locale compile one, which needs
/// localedef and its sources; where they are not there, `c_too` is false.
class CommaLocale {
  public:
    CommaLocale() : before_(std::locale()) {
        for (const char* name : {"de_DE.UTF-8", "fr_FR.UTF-8", "it_IT.UTF-8", "es_ES.UTF-8"}) c_too |= set(name);
        if (!c_too) c_too = compiled();
        std::locale::global(std::locale(std::locale::classic(), new Comma));  // has no name: C's stays
    }
    ~CommaLocale() {
        std::locale::global(before_);
        std::setlocale(LC_ALL, "C");
        if (folder_.empty()) return;
        unsetenv("LOCPATH");
        std::error_code ignored;
        std::filesystem::remove_all(folder_, ignored);
    }
    CommaLocale(const CommaLocale&) = delete;
    CommaLocale& operator=(const CommaLocale&) = delete;
    bool c_too = false;

  private:
    struct Comma : std::numpunct<char> {
        char do_decimal_point() const override { return ','; }
        char do_thousands_sep() const override { return '.'; }
        std::string do_grouping() const override { return "\3"; }
    };
    static bool set(const char* name) {
        return std::setlocale(LC_ALL, name) != nullptr && *std::localeconv()->decimal_point == ',';
    }
    bool compiled() {
        folder_ = (std::filesystem::temp_directory_path() / "palpate-locale-XXXXXX").string();
        if (!mkdtemp(folder_.data())) return folder_.clear(), false;
        const std::string command = "localedef -c -i de_DE -f UTF-8 " + folder_ + "/de_DE.UTF-8 >/dev/null 2>&1";
        if (std::system(command.c_str()) < 0) return false;
        setenv("LOCPATH", folder_.c_str(), 1);
        return set("de_DE.UTF-8");
    }
    std::locale before_;
    std::string folder_;
};

}  // namespace palpate::testing
