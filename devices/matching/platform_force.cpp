#include "devices/matching/platform_force.h"

#include <algorithm>
#include <cmath>

#include "devices/matching/small_systems.h"

namespace palpate {

Coordinates torques_for_force(const DeviceModel& model, const Coordinates& w, double force) {
    const Platform platform = model.kind->platform(model, w);
    const Joints joints = model.kind->joints(model, w);
    const Coordinates along_w = platform.dcentre.transpose().lazyProduct(force * platform.normal);
    // dq' torque = dcentre' n force.
    return solve_square(joints.dq.transpose(), along_w);
}

Coordinates pressed_on(const DeviceModel& model, const Coordinates& w, double distance) {
    const Platform platform = model.kind->platform(model, w);
    const auto n = w.size();
    // Tilts count by what they move at the platform's rim.
    Eigen::Matrix<double, 6, Eigen::Dynamic, 0, 6, max_device_dimension> ways(6, n);
    ways << platform.dcentre, std::max(model.disk_radius, 0.01) * platform.dnormal;
    Eigen::Matrix<double, 6, 1> wanted = Eigen::Matrix<double, 6, 1>::Zero();
    wanted.head<3>() = distance * platform.normal;
    // Damped in the scale of each component: a chain may be singular, and is then to stay where it is.
    const Coordinates scale = model.kind->configuration_scale;
    const auto S = scale.asDiagonal();
    DeviceJacobian normal = ways.transpose().lazyProduct(ways);
    normal = S * normal * S;
    normal.diagonal().array() += 1e-9 * std::max(normal.trace(), 1e-12);
    const SmallCholesky factor(normal);
    Coordinates step = S * ways.transpose().lazyProduct(wanted);
    factor.solve(step.data());
    step = S * step;
    if (factor.n == 0 || !step.allFinite()) return w;
    double share = 1;
    for (int k = 0; k < 20 && !inside_workspace(model, w + share * step, 1e-9); ++k) share *= 0.7;
    const Coordinates there = w + share * step;
    return inside_workspace(model, there, 1e-9) ? there : w;
}

Coordinates limit_torque(const Coordinates& torque, const Coordinates& largest) {
    Coordinates limited = torque;
    for (int i = 0; i < limited.size(); ++i) {
        const double most = i < largest.size() && std::isfinite(largest[i]) ? std::max(0.0, largest[i]) : 0;
        limited[i] = std::isfinite(torque[i]) ? std::clamp(torque[i], 0.0, most) : 0;
    }
    return limited;
}

Coordinates largest_torques(const DeviceModel& model) {
    const DeviceKind& kind = *model.kind;
    const ConfigurationBox box = search_box(model);
    const auto n = box.low.size();
    Coordinates largest = Coordinates::Zero(kind.joint_count);
    constexpr int points = 5;
    int count = 1;
    for (std::ptrdiff_t i = 0; i < n; ++i) count *= points;
    for (int k = 0; k < count; ++k) {
        Coordinates w(n);
        for (std::ptrdiff_t i = 0, rest = k; i < n; ++i, rest /= points)
            w[i] = box.low[i] + double(rest % points) / (points - 1) * (box.high[i] - box.low[i]);
        if (!inside_workspace(model, w)) continue;
        const Coordinates torque = torques_for_force(model, w, model.max_force);
        if (torque.allFinite()) largest = largest.cwiseMax(torque.cwiseAbs());
    }
    // Near a singularity any force takes any torque: no more than ten times the rest configuration's.
    const Coordinates at_rest = torques_for_force(model, model.rest, model.max_force);
    if (at_rest.allFinite() && at_rest.norm() > 0)
        largest = largest.cwiseMax(at_rest.cwiseAbs()).cwiseMin(10 * at_rest.cwiseAbs().maxCoeff());
    return largest;
}

}  // namespace palpate
