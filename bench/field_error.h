#pragma once
// How far the contact forces of a run are from a reference's.

#include <cstddef>
#include <vector>

#include "engine/math/linear_algebra.h"

namespace palpate {

using ForceFields = std::vector<std::vector<Vec3<double>>>;  ///< [step][sample] [N]

/// Means over the steps in contact (reference forces of more than `least` N together) of
/// sum |F_i - Fref_i| / sum |Fref_i|, and of the same for the total force.
struct FieldError {
    double field = 0, total = 0;
};
inline FieldError field_error(const ForceFields& forces, const ForceFields& reference, double least) {
    FieldError error;
    int steps = 0;
    for (std::size_t k = 0; k < forces.size(); ++k) {
        double difference = 0, size = 0;
        Vec3<double> sum{0, 0, 0}, sum_reference{0, 0, 0};
        for (std::size_t i = 0; i < forces[k].size(); ++i) {
            difference += norm(forces[k][i] - reference[k][i]);
            size += norm(reference[k][i]);
            sum += forces[k][i];
            sum_reference += reference[k][i];
        }
        if (size < least) continue;
        error.field += difference / size;
        error.total += norm(sum - sum_reference) / norm(sum_reference);
        ++steps;
    }
    return {error.field / steps, error.total / steps};
}

}  // namespace palpate
