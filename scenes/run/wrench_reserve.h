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

/// Components of a wrench, as columns.
using WrenchBasis = Eigen::Matrix<double, 6, Eigen::Dynamic, 0, 6, 6>;

/// Largest multiple of a wrench (force [N], torque about the point of reference [N m]) that friction can take beside
/// the one it takes now, normal forces as they are: how far the limit surface is along it. The limit surface bounds the
/// sum of discs, one per sample, in its tangent plane (Goyal, Ruina and Papadopoulos 1991); found by its support
/// function. `kept`: orthogonal components that stay as they are, or grow with the wrench, which lies among them; the
/// others are left to other contacts. By default all six.
double wrench_reserve(const std::vector<GripSample>& samples, const Motion& wrench,
                      const WrenchBasis& kept = WrenchBasis::Identity(6, 6));

/// What a grip can still resist as a soft finger (Salisbury 1982): forces along its mean tangent plane, and torque
/// about its mean normal.
struct GripReserve {
    double weakest_N = 0;   ///< force in the weakest direction, through the middle of the grip
    double load_N = 0;      ///< force along `load`'s part along the surface
    double twist_N_mm = 0;  ///< torque, in the weaker sense
};
GripReserve grip_reserve(const std::vector<GripSample>& samples, const Vec3<double>& load);

}  // namespace palpate
