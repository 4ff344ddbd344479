#pragma once
// Random numbers, and text that holds them: what random scenes are drawn with.

#include <cmath>
#include <cstdint>
#include <initializer_list>
#include <string>

#include "meshes/split_mix.h"

namespace palpate {

/// Small and the same everywhere: the standard library's distributions differ between implementations.
struct Random {
    std::uint64_t state;
    std::uint64_t next() { return split_mix(state += 0x9e3779b97f4a7c15u); }
    double between(double low, double high) { return low + (high - low) * double(next() >> 11) * 0x1p-53; }
    double log_between(double low, double high) { return std::exp(between(std::log(low), std::log(high))); }
    int integer(int low, int high) { return low + int(next() % std::uint64_t(high - low + 1)); }
    bool chance(double share) { return between(0, 1) < share; }
    const char* one_of(std::initializer_list<const char*> words) {
        return *(words.begin() + next() % std::uint64_t(words.size()));
    }
};

/// As printf would; up to 239 characters.
[[gnu::format(printf, 1, 2)]] std::string line(const char* format, ...);

/// A ball of 80 facets with dents and bumps, 16 to 28 mm across; OBJ, in mm.
std::string lumpy_ball(Random& r);

}  // namespace palpate
