#pragma once
// Numbers of a frame as bytes, little-endian.

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <vector>

namespace palpate {

static_assert(std::endian::native == std::endian::little, "frames are little-endian");

template <class T>
void put(std::vector<std::uint8_t>& out, T value) {
    const std::size_t at = out.size();
    out.resize(at + sizeof(T));
    std::memcpy(out.data() + at, &value, sizeof(T));
}
/// In units of `unit`, at the ends of the type's range where it does not fit.
template <class T>
void put_scaled(std::vector<std::uint8_t>& out, double value, double unit) {
    const double scaled = std::isfinite(value) ? std::round(value / unit) : 0;
    put(out, T(std::clamp(scaled, double(std::numeric_limits<T>::min()), double(std::numeric_limits<T>::max()))));
}

}  // namespace palpate
