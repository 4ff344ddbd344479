#pragma once
// Bounds of a setting, stated once and used by whoever checks or reads it.

namespace palpate {

/// Values from `low` to `high`, both included, in SI units.
struct Range {
    double low, high;
    /// False for NaN.
    constexpr bool holds(double value) const { return value >= low && value <= high; }
};

}  // namespace palpate
