#pragma once

#include <cstdint>

namespace palpate {

/// SplitMix's last step (Steele, Lea and Flood 2014): every bit of the number moves every other.
inline std::uint64_t split_mix(std::uint64_t x) {
    x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9u;
    x = (x ^ (x >> 27)) * 0x94d049bb133111ebu;
    return x ^ (x >> 31);
}

}  // namespace palpate
