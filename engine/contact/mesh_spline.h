#pragma once
// Quadratic B-splines over the cells of a grid: what the smooth field of a mesh (mesh_distance_field.cpp) is made of.

#include <cmath>
#include <cstddef>

#include "engine/math/linear_algebra.h"

namespace palpate {

/// A function with its derivatives at a point.
struct SampledField {
    double value;
    Vec3<double> gradient;
    Mat3<double> hessian;
};

/// The same without second derivatives.
struct SlopedField {
    double value;
    Vec3<double> gradient;
};

/// 3x3x3 cells: those along x follow each other from first + j up + k deep. One number more than they are is read.
struct CellBlock {
    const float* first;
    std::size_t up, deep;
};

/// The spline over them: once continuously differentiable, and exact where what it is over is linear. `away`: from the
/// middle cell's centre [cells]; `per_cell`: one over a cell's edge [1/m]. Second derivatives are found where the value
/// is within `bent_within` of zero, and are zeros elsewhere. The same bits with every set of instructions.
SampledField spline_field(const Vec3<double>& away, double per_cell, const CellBlock& cells,
                          double bent_within = HUGE_VAL);
/// The same with the instructions that every processor has.
SampledField plain_spline_field(const Vec3<double>& away, double per_cell, const CellBlock& cells,
                                double bent_within = HUGE_VAL);

/// Near the surface, distance over the length of its gradient: smoothing makes that shorter than one at rims and thin
/// walls, and a force along it would not be as large as its multiplier says. psi = phi (1 + w q): w falls from one at
/// the surface to zero 1 / `per_band` away from it, q = 1 / sqrt(m) - 1 with m = |grad phi|^2, which short gradients do
/// not let vanish. The gradient is that of psi, of length one where psi = 0.
SlopedField of_unit_slope(const SampledField& f, double per_band);
/// Both in one go: of a spline.
SlopedField spline_of_unit_slope(const Vec3<double>& away, double per_cell, const CellBlock& cells, double per_band);

}  // namespace palpate
