#pragma once
// Bounds of a setting, stated once and used by whoever checks or reads it.

#include <string>
#include <vector>

namespace palpate {

/// Values from `low` to `high`, both included, in SI units.
struct Range {
    double low, high;
    /// False for NaN.
    constexpr bool holds(double value) const { return value >= low && value <= high; }
};

/// Adds a sentence where a value is not finite or out of range.
void check(double value, const Range& range, const char* what, const char* unit, std::vector<std::string>& wrong);

}  // namespace palpate
