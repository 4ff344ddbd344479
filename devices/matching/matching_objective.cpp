#include "devices/matching/matching_objective.h"

#include <array>
#include <cmath>

namespace palpate {

namespace {

constexpr double mm2 = 1e6;  // objective in mm^2

using Vector6d = Eigen::Matrix<double, 6, 1>;
using Matrix6d = Eigen::Matrix<double, 6, 6>;

/// Sums over samples in platform coordinates, centre first, then normal [m].
struct PlatformSums {
    double value = 0;
    Vector6d gradient = Vector6d::Zero();  ///< J' r
    Matrix6d hessian = Matrix6d::Zero();   ///< J' J, lower half
    // Samples over the platform's face: residual h = offset . normal, row [-normal, offset]. Their sums are of offsets
    // alone, and are put together at the end.
    double weight = 0, heights = 0;
    Eigen::Vector3d offsets = Eigen::Vector3d::Zero(), height_offsets = Eigen::Vector3d::Zero();
    std::array<double, 6> products{};  ///< of offsets: xx, yx, yy, zx, zy, zz
};

template <bool with_hessian>
void add_above_face(PlatformSums& sums, double height, const Eigen::Vector3d& offset, double weight) {
    const double weighted = weight * height;
    sums.value += weighted * height;
    sums.heights += weighted;
    sums.height_offsets += weighted * offset;
    if constexpr (with_hessian) {
        sums.weight += weight;
        sums.offsets += weight * offset;
        for (int i = 0, k = 0; i < 3; ++i)
            for (int j = 0; j <= i; ++j, ++k) sums.products[std::size_t(k)] += weight * offset[i] * offset[j];
    }
}

template <bool with_hessian>
void put_together(PlatformSums& sums, const Eigen::Vector3d& normal) {
    sums.gradient.head<3>() -= sums.heights * normal;
    sums.gradient.tail<3>() += sums.height_offsets;
    if constexpr (with_hessian) {
        sums.hessian.topLeftCorner<3, 3>() += sums.weight * normal * normal.transpose();
        sums.hessian.bottomLeftCorner<3, 3>() -= sums.offsets * normal.transpose();
        for (int i = 0, k = 0; i < 3; ++i)
            for (int j = 0; j <= i; ++j, ++k) sums.hessian(3 + i, 3 + j) += sums.products[std::size_t(k)];
    }
}

template <bool with_hessian>
void add(PlatformSums& sums, double residual, const Eigen::Vector3d& dcentre, const Eigen::Vector3d& dnormal,
         double weight) {
    Vector6d row;
    row << dcentre, dnormal;
    sums.value += weight * residual * residual;
    sums.gradient += weight * residual * row;
    if constexpr (with_hessian)
        for (int k = 0; k < 6; ++k) sums.hessian.col(k).tail(6 - k) += weight * row[k] * row.tail(6 - k);
}

/// One sample of Eq. 3. Above the platform's face nothing needs a square root.
template <bool with_hessian>
void add_sample(PlatformSums& sums, const MatchingPoint& point, const Platform& platform, double radius,
                double clearance) {
    const Eigen::Vector3d offset = point.position - platform.centre;
    const double height = offset.dot(platform.normal);
    if (!point.touches && height >= clearance) return;  // the distance to the cone is no smaller
    if (point.touches && offset.squaredNorm() - height * height <= radius * radius)
        return add_above_face<with_hessian>(sums, height, offset, point.weight);
    const DiskDistance d = point.touches ? disk_distance(point.position, platform, radius)
                                         : cone_distance(point.position, platform, radius);
    const double excess = point.touches ? d.value : d.value - clearance;
    if (point.touches || excess < 0) add<with_hessian>(sums, excess, d.dcentre, d.dnormal, point.weight);
}

template <bool with_hessian>
PlatformSums sum_over(const DeviceModel& model, const NearSamples& samples, const MatchingSettings& settings,
                      const Platform& platform) {
    PlatformSums sums;
    const std::vector<MatchingPoint>& points = *samples.points;
    if (samples.hold_for(platform)) {
        for (int i = 0; i < samples.count; ++i)
            add_sample<with_hessian>(sums, points[std::size_t(samples.index[std::size_t(i)])], platform,
                                     model.disk_radius, model.clearance);
    } else {
        for (const MatchingPoint& point : points)
            if (point.touches || settings.non_contact)
                add_sample<with_hessian>(sums, point, platform, model.disk_radius, model.clearance);
    }
    put_together<with_hessian>(sums, platform.normal);
    return sums;
}

/// Weight of the smoothing. A little of it always: where a single point touches, the tilt is otherwise free.
double smoothing_weight(const MatchingSettings& settings) { return settings.smoothing + 1e-6; }

/// J' r in the device's coordinates, smoothing included; adds the smoothing's value to `value`.
Coordinates device_gradient(const DeviceModel& model, const PlatformSums& sums, const Platform& platform,
                            const MatchingSettings& settings, const Coordinates& previous, const Coordinates& w,
                            double& value) {
    Coordinates gradient = mm2 * (platform.dcentre.transpose().lazyProduct(sums.gradient.head<3>()) +
                                  platform.dnormal.transpose().lazyProduct(sums.gradient.tail<3>()));
    const Coordinates& scale = model.kind->configuration_scale;
    const Coordinates d = (w - previous).cwiseQuotient(scale);
    gradient += smoothing_weight(settings) * d.cwiseQuotient(scale);
    value = mm2 * sums.value + smoothing_weight(settings) * d.squaredNorm();
    return gradient;
}

}  // namespace

NearSamples near_samples(const DeviceModel& model, const std::vector<MatchingPoint>& points,
                         const MatchingSettings& settings, const Coordinates& w) {
    NearSamples near;
    near.points = &points;
    const Platform platform = model.kind->platform(model, w);
    near.centre = platform.centre;
    near.normal = platform.normal;
    double reach2 = 0;
    for (std::size_t i = 0; i < points.size(); ++i) {
        const MatchingPoint& point = points[i];
        if (!point.touches && !settings.non_contact) continue;
        const Eigen::Vector3d offset = point.position - platform.centre;
        const double height = offset.dot(platform.normal), distance2 = offset.squaredNorm();
        reach2 = std::max(reach2, distance2);
        const double bound = model.clearance + NearSamples::trust;
        if (!point.touches) {
            if (height >= bound) continue;
            const double beside = std::sqrt(std::max(0.0, distance2 - height * height)) - model.disk_radius;
            if ((beside + height) * std::sqrt(0.5) >= bound) continue;
        }
        near.all |= near.count == NearSamples::capacity;
        if (!near.all) near.index[std::size_t(near.count++)] = int(i);
    }
    near.reach = std::sqrt(reach2);
    return near;
}

MatchingResiduals matching_residuals(const DeviceModel& model, const NearSamples& samples,
                                     const MatchingSettings& settings, const Coordinates& previous,
                                     const Coordinates& w) {
    const Platform platform = model.kind->platform(model, w);
    PlatformSums sums = sum_over<true>(model, samples, settings, platform);
    MatchingResiduals r;
    r.gradient = device_gradient(model, sums, platform, settings, previous, w, r.value);
    Eigen::Matrix<double, 6, Eigen::Dynamic, 0, 6, max_device_dimension> J(6, w.size());
    J << platform.dcentre, platform.dnormal;
    sums.hessian.triangularView<Eigen::StrictlyUpper>() = sums.hessian.transpose();
    const DeviceJacobian half = sums.hessian.lazyProduct(J);
    r.hessian = mm2 * J.transpose().lazyProduct(half);
    r.hessian.diagonal() += smoothing_weight(settings) * model.kind->configuration_scale.cwiseAbs2().cwiseInverse();
    return r;
}

MatchingObjective matching_objective(const DeviceModel& model, const NearSamples& samples,
                                     const MatchingSettings& settings, const Coordinates& previous,
                                     const Coordinates& w) {
    const Platform platform = model.kind->platform(model, w);
    const PlatformSums sums = sum_over<false>(model, samples, settings, platform);
    MatchingObjective f;
    f.gradient = 2 * device_gradient(model, sums, platform, settings, previous, w, f.value);
    return f;
}

MatchingObjective matching_objective(const DeviceModel& model, const std::vector<MatchingPoint>& points,
                                     const MatchingSettings& settings, const Coordinates& previous,
                                     const Coordinates& w) {
    NearSamples every;
    every.points = &points;
    every.all = true;
    return matching_objective(model, every, settings, previous, w);
}

}  // namespace palpate
