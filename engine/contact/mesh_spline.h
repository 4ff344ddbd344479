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

}  // namespace palpate
