#pragma once
// The objective of contact surface matching (Perez et al. 2017, Eq. 3), as the searches evaluate it: summed in the
// coordinates of the platform (its centre and normal), taken to those of the device once, over the samples that can
// come near the platform alone.

#include <array>
#include <vector>

#include "devices/matching/fitted.h"
#include "devices/matching/matching.h"

namespace palpate {

/// Samples that the platform can touch as long as no point of it moves farther than `trust`: those that must be
/// touched, and those that are nearer than that. The rest adds nothing to Eq. 3, so that an evaluation costs what the
/// contact costs and not what the mesh does.
struct NearSamples {
    static constexpr int capacity = 256;
    static constexpr double trust = fitted::trust;  ///< [m]
    const std::vector<MatchingPoint>* points = nullptr;
    std::array<int, capacity> index;  ///< into points
    int count = 0;
    bool all = false;  ///< more are near than `index` takes
    Eigen::Vector3d centre, normal;
    double reach = 0;  ///< of the farthest sample from the centre [m]

    /// Whether what was left out is out of reach for this platform, too. A sample's distance to the platform changes by
    /// no more than the platform's move there: that of its centre, and its turn times the sample's distance from it.
    bool hold_for(const Platform& platform) const {
        return !all && (platform.centre - centre).norm() + reach * (platform.normal - normal).norm() <= trust;
    }
};

/// Near samples about the platform of configuration w.
NearSamples near_samples(const DeviceModel& model, const std::vector<MatchingPoint>& points,
                         const MatchingSettings& settings, const Coordinates& w);

/// Eq. 3 with the temporal smoothing about `previous`, and what Gauss-Newton needs of it: distances are the residuals,
/// and the rows of J their gradients.
struct MatchingResiduals {
    double value = 0;        ///< f(w) [mm^2]
    Coordinates gradient;    ///< J' r, half of df/dw
    DeviceJacobian hessian;  ///< J' J
};
MatchingResiduals matching_residuals(const DeviceModel& model, const NearSamples& samples,
                                     const MatchingSettings& settings, const Coordinates& previous,
                                     const Coordinates& w);

/// Value and gradient alone.
MatchingObjective matching_objective(const DeviceModel& model, const NearSamples& samples,
                                     const MatchingSettings& settings, const Coordinates& previous,
                                     const Coordinates& w);

}  // namespace palpate
