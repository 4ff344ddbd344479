#pragma once
// What of a finger can be fitted.

#include <functional>
#include <string>
#include <vector>

#include "scenes/load/finger_model.h"

namespace palpate {

/// Something of a finger that can be fitted, between bounds, in the unit of finger files.
struct FitParameter {
    std::string name;  ///< "young_kPa"
    double low = 0, high = 1;
    bool logarithmic = false;  ///< bounds span decades
    std::function<double(const FingerModel&)> get;
    std::function<void(FingerModel&, double)> set;
};
/// Those a finger has: young_kPa (layers keep their ratio to it), poisson, low, high; of a parametric one length_mm,
/// width_mm, thickness_mm, pad_bulge; of its layers layer_1_young_kPa, layer_1_low, layer_1_high, ...
std::vector<FitParameter> fit_parameters(const FingerModel& model);

/// Those of the given names. Throws InputError where one does not exist, or none is named.
std::vector<FitParameter> chosen_parameters(const FingerModel& model, const std::vector<std::string>& names);

}  // namespace palpate
