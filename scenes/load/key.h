#pragma once
// What may stand in a file under one key. A reader states it where it reads the key (section.h); help, schema,
// reference and checks are made from that.

#include <list>
#include <string>
#include <vector>

#include "devices/range.h"

namespace palpate {

/// How a number is written in a file.
struct Unit {
    const char* name;
    double si;  ///< one of it in SI units
};

namespace unit {
inline constexpr double pi = 3.14159265358979323846;
inline constexpr Unit one{"", 1}, m{"m", 1}, mm{"mm", 1e-3}, um{"um", 1e-6}, s{"s", 1}, ms{"ms", 1e-3}, Hz{"Hz", 1};
inline constexpr Unit deg{"deg", pi / 180}, deg_per_s{"deg/s", pi / 180}, rad_per_s{"rad/s", 1},
    rad_per_s2{"rad/s^2", 1};
inline constexpr Unit m_per_s{"m/s", 1}, um_per_s{"um/s", 1e-6}, mm_per_s{"mm/s", 1e-3}, m_per_s2{"m/s^2", 1},
    mm_per_rad{"mm/rad", 1e-3};
inline constexpr Unit kPa{"kPa", 1e3}, kPa_per_mm{"kPa/mm", 1e6}, g{"g", 1e-3}, kg_per_m3{"kg/m^3", 1};
inline constexpr Unit N{"N", 1}, Nm{"N m", 1}, N_per_mm{"N/mm", 1e3}, Ns_per_m{"N s/m", 1}, Nm_per_rad{"N m/rad", 1},
    Nms_per_rad{"N m s/rad", 1};
inline constexpr Unit Hz_per_mm_per_s{"Hz per mm/s", 1}, Hz_per_deg_per_s{"Hz per deg/s", 1};
inline constexpr Unit us{"us", 1}, us_per_rad{"us/rad", 1}, ticks{"ticks", 1}, ticks_per_rad{"ticks/rad", 1},
    per_Nm{"per N m", 1};
}  // namespace unit

/// Bounds in the unit of a file, from those in SI units: twelve digits, and never outside.
Range in(const Unit& unit, const Range& si);

/// Values that people mean, in the unit of the file; what lies outside is accepted with a warning that names the unit
/// it looks like. No word where a unit is empty and nothing is said of that side.
struct Likely {
    double low, high;
    const char *looks_below = "", *looks_above = "";
};

/// A key's name, and the one it had before: that is still accepted, with a note.
struct Name {
    Name(const char* now) : now(now) {}
    Name(std::string now) : now(std::move(now)) {}
    Name(const char* now, const char* before) : now(now), before(before) {}
    std::string now, before;
};

struct KeyInfo {
    enum class Type { number, integer, boolean, text, choice, vector, integers, table, tables };
    Type type = Type::table;
    std::string name, before, sentence;
    std::string unit;                   ///< empty: a pure number
    Range range{0, 0};                  ///< in that unit; of a vector, of each component
    std::string fallback;               ///< as it would be written; empty: nothing
    std::vector<std::string> words;     ///< of a choice
    std::vector<std::string> synonyms;  ///< older words that are accepted, too
    bool required = false;
    std::list<KeyInfo> keys;  ///< of a table, in the order in which they are read
};

std::string joined(const std::vector<std::string>& words);
/// A number as people write it: six digits at most.
std::string number_text(double x);
/// Whether a word may be a slip for a known one: a few letters differ, or its unit is left out.
bool is_much_like(const std::string& word, const std::string& known);
/// "did you mean 'x'?", or all that there is.
std::string nearest_or_all(const std::string& word, const std::vector<std::string>& known);

}  // namespace palpate
