#include "devices/matching/descent.h"

#include <numbers>

#include "devices/matching/fitted.h"
#include "devices/matching/least_squares.h"
#include "devices/matching/small_systems.h"

namespace palpate {

Descent descend(const DeviceModel& model, const NearSamples& samples, const MatchingSettings& settings,
                const Coordinates& previous, const Coordinates& start) {
    Descent at;
    at.w = start;
    MatchingResiduals r = matching_residuals(model, samples, settings, previous, start);
    at.value = r.value;
    at.evaluations = 1;
    at.end = DescentEnd::converged;
    double damping = 1e-6;
    const Coordinates scale2 = model.kind->configuration_scale.cwiseAbs2().cwiseInverse();
    while (at.evaluations < settings.evaluations) {
        DeviceJacobian H = r.hessian;
        H.diagonal() += damping * (H.diagonal() + scale2);
        const Coordinates w = move_inside_limits(model, at.w, step_inside_limits(model, at.w, H, r.gradient));
        if ((w - at.w).cwiseQuotient(model.kind->configuration_scale).norm() < settings.tolerance) return at;
        const MatchingResiduals next = matching_residuals(model, samples, settings, previous, w);
        ++at.evaluations;
        if (next.value < at.value) {
            const double gained = at.value - next.value;
            at.w = w;
            at.value = next.value;
            r = next;
            damping = std::max(1e-9, 0.1 * damping);
            if (gained < settings.tolerance * settings.tolerance * (1 + at.value)) return at;
        } else {
            damping = std::max(1e-4, 10 * damping);
            if (!std::isfinite(damping) || damping > 1e8) return at;
        }
    }
    at.end = DescentEnd::budget;
    return at;
}

Descent descend_from_everywhere(const DeviceModel& model, const std::vector<MatchingPoint>& points,
                                const MatchingSettings& settings, const Coordinates& previous) {
    static constexpr int primes[max_device_dimension] = {2, 3, 5, 7, 11, 13};  // Halton's sequence
    const Coordinates low = model.kind->open_chain ? model.joint_min : model.kind->configuration_min;
    const Coordinates high = model.kind->open_chain ? model.joint_max : model.kind->configuration_max;
    Descent best;
    for (int k = 1; k <= fitted::starts_everywhere; ++k) {
        Coordinates w(previous.size());
        for (std::ptrdiff_t i = 0; i < w.size(); ++i) {
            double f = 1, u = 0;
            for (int x = k; x > 0; x /= primes[i]) u += (f /= primes[i]) * (x % primes[i]);
            w[i] = low[i] + u * (high[i] - low[i]);
        }
        w = project_to_workspace(model, w);
        const int evaluations = best.evaluations;
        const Descent d = descend(model, near_samples(model, points, settings, w), settings, previous, w);
        if (d.value < best.value) best = d;
        best.evaluations = evaluations + d.evaluations;
    }
    return best;
}

Descent descend_from_the_sides(const DeviceModel& model, const std::vector<MatchingPoint>& points,
                               const MatchingSettings& settings, const Coordinates& previous, const Descent& found) {
    Descent best;
    if (settings.sideways_starts == 0 || found.w.size() < 2 || found.value < fitted::nothing_to_gain) return best;
    const Platform platform = model.kind->platform(model, found.w);
    Eigen::Vector3d centre = Eigen::Vector3d::Zero();
    double weights = 0;
    for (const MatchingPoint& p : points)
        if (p.touches) centre += p.weight * p.position, weights += p.weight;
    centre /= weights;
    centre -= platform.normal.dot(centre - platform.centre) * platform.normal;

    // Moves of w that slide the platform along itself and leave its plane: there are two, or none.
    constexpr double lever = fitted::slide_lever;
    Eigen::Matrix<double, 6, Eigen::Dynamic, 0, 6, max_device_dimension> J(6, found.w.size());
    J << platform.dcentre, lever * platform.dnormal;
    const Coordinates& scale = model.kind->configuration_scale;
    const auto J_scaled = (J * scale.asDiagonal()).eval();
    DeviceJacobian normal_matrix = J_scaled.transpose().lazyProduct(J_scaled);
    normal_matrix.diagonal().array() += 1e-9 * normal_matrix.diagonal().maxCoeff();
    const SmallCholesky factor(normal_matrix);
    if (factor.n == 0) return best;
    const Eigen::Vector3d axis = platform.normal.unitOrthogonal(), other = platform.normal.cross(axis);
    // A few steps from each, and more from the best where it promises something.
    MatchingSettings rough = settings;
    rough.evaluations = std::min(4, settings.evaluations);
    rough.tolerance = std::max(1e-2, settings.tolerance);
    for (int k = 0; k < settings.sideways_starts; ++k) {
        const double phi = 2 * std::numbers::pi * k / settings.sideways_starts;
        const Eigen::Vector3d wanted =
            centre + 0.9 * model.disk_radius * (std::cos(phi) * axis + std::sin(phi) * other) - platform.centre;
        Eigen::Matrix<double, 6, 1> slide;
        slide << wanted, Eigen::Vector3d::Zero();
        Coordinates d = J_scaled.transpose().lazyProduct(slide);
        factor.solve(d.data());
        d.array() *= scale.array();
        if ((J.lazyProduct(d) - slide).norm() > 0.01 * slide.norm()) return best;  // it cannot slide
        const Coordinates w = move_inside_limits(model, found.w, d);
        const int evaluations = best.evaluations;
        const Descent e = descend(model, near_samples(model, points, settings, w), rough, previous, w);
        if (e.value < best.value) best = e;
        best.evaluations = evaluations + e.evaluations;
    }
    if (best.value > 2 * found.value) return best;
    MatchingSettings fine = settings;
    fine.evaluations = std::min(30, settings.evaluations);
    fine.tolerance = std::max(1e-3, settings.tolerance);
    const int evaluations = best.evaluations;
    best = descend(model, near_samples(model, points, settings, best.w), fine, previous, best.w);
    best.evaluations += evaluations;
    return best;
}

}  // namespace palpate
