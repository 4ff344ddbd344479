#pragma once
// Measured indentations of a finger, from a CSV file.

#include <filesystem>
#include <vector>

namespace palpate {

struct MeasuredPoint {
    double displacement = 0;  ///< [m]; NaN where it was not measured
    double force = 0;         ///< [N]
    double area = 0;          ///< [m^2]; NaN where it was not measured
};

/// One press of a flat plate.
struct MeasuredCurve {
    double angle = 0;  ///< between plate and finger axis [rad]
    std::vector<MeasuredPoint> points;
};

/// Reads a table with a header line. Columns, whose names carry their unit: force_N (or _mN, _gf); displacement_mm (or
/// _um, _m) and area_mm2 (or _cm2, _m2), at least one of them; angle_deg (or _rad), by which rows belong to one
/// press; without it, all do. Lines that begin with # are left out. Throws InputError with every problem and its line:
/// columns missing or unknown, cells that are no number, values below zero, rows that do not rise, rows that are
/// repeated, fewer than five rows in a press, and values that no fingertip can have, with the unit they look like.
std::vector<MeasuredCurve> read_measured_curves(const std::filesystem::path& path);

}  // namespace palpate
