#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

namespace palpate {

/// The value below which `share` of them lie; `share` below one.
inline double quantile(std::vector<double> values, double share) {
    const auto at = values.begin() + std::ptrdiff_t(share * double(values.size()));
    std::nth_element(values.begin(), at, values.end());
    return *at;
}

}  // namespace palpate
