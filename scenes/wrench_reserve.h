#pragma once
// What a finger's grip on an object can still resist before it slips.

#include <vector>

#include "engine/bodies/rigid_body.h"

namespace palpate {

/// Friction of one sample on an object.
struct GripSample {
    Vec3<double> point{0, 0, 0};     ///< from a point of reference [m]
    Vec3<double> normal{0, 0, 1};    ///< unit
    double friction_limit = 0;       ///< Coulomb coefficient times normal force [N]
    Vec3<double> friction{0, 0, 0};  ///< [N]
};

/// Largest multiple of a wrench (force [N], torque about the point of reference [N m]) that friction can take beside
/// the one it takes now, normal forces as they are: how far the limit surface is along it. The limit surface bounds the
/// sum of discs, one per sample, in its tangent plane (Goyal, Ruina and Papadopoulos 1991); found by its support
/// function.
double wrench_reserve(const std::vector<GripSample>& samples, const Motion& wrench);

/// What a grip can still resist.
struct GripReserve {
    double weakest_N = 0;   ///< force in the weakest direction along the surface, through the middle of the grip
    double load_N = 0;      ///< force along `load`'s part along the surface
    double twist_N_mm = 0;  ///< torque about the mean normal, in the weaker sense
};
GripReserve grip_reserve(const std::vector<GripSample>& samples, const Vec3<double>& load);

}  // namespace palpate
