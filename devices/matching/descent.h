#pragma once
// Searches for the minimum of Eq. 3 by least squares: from one configuration, from many, and from beside the contact.

#include <cmath>

#include "devices/matching/matching_objective.h"

namespace palpate {

enum class DescentEnd { converged, budget, failed };

/// Where a search has ended: the best configuration inside the joint limits that it has seen.
struct Descent {
    Coordinates w;
    double value = HUGE_VAL;  ///< of the objective [mm^2]
    int evaluations = 0;
    DescentEnd end = DescentEnd::budget;
};

/// Levenberg-Marquardt from `start`, which is inside the joint limits; smoothing about `previous`.
Descent descend(const DeviceModel& model, const NearSamples& samples, const MatchingSettings& settings,
                const Coordinates& previous, const Coordinates& start);

/// From 64 places that fill the workspace evenly, and the best of them.
Descent descend_from_everywhere(const DeviceModel& model, const std::vector<MatchingPoint>& points,
                                const MatchingSettings& settings, const Coordinates& previous);

/// Of a platform that can slide along itself: from places around `found` at which the same plane carries the contact
/// elsewhere on the disk, `settings.sideways_starts` of them. Eq. 3 has a minimum wherever samples that must not be
/// touched lie just beyond the rim. Nothing (value HUGE_VAL) for a device that cannot slide.
Descent descend_from_the_sides(const DeviceModel& model, const std::vector<MatchingPoint>& points,
                               const MatchingSettings& settings, const Coordinates& previous, const Descent& found);

}  // namespace palpate
