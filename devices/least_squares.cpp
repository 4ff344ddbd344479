#include "devices/least_squares.h"

#include <cmath>

namespace palpate {

Coordinates step_inside_limits(const DeviceModel& model, const Coordinates& w, const DeviceJacobian& H,
                               const Coordinates& g) {
    constexpr int most = 4 * max_device_dimension;
    const DeviceKind& kind = *model.kind;
    const auto n = w.size();
    const Joints joints = kind.joints(model, w);
    const auto margins = joint_margins(model, joints.q);
    // Rows of a' d >= -c: joints above and below their limits, and the box of the search.
    Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, most, max_device_dimension> A(4 * n, n);
    Eigen::Matrix<double, Eigen::Dynamic, 1, 0, most, 1> c(4 * n);
    const auto J = joints.q.size();
    A.setZero();
    c.setConstant(1);
    for (std::ptrdiff_t j = 0; j < J && j < n; ++j) {
        A.row(j) = joints.dq.row(j), c[j] = margins[j];
        A.row(n + j) = -joints.dq.row(j), c[n + j] = margins[J + j];
    }
    if (!kind.open_chain)
        for (std::ptrdiff_t k = 0; k < n; ++k) {
            A(2 * n + k, k) = 1, c[2 * n + k] = w[k] - kind.configuration_min[k];
            A(3 * n + k, k) = -1, c[3 * n + k] = kind.configuration_max[k] - w[k];
        }
    const Eigen::LDLT<DeviceJacobian> factor(H);
    const Coordinates free = factor.solve(-g);
    Coordinates d = free;
    Eigen::Matrix<double, Eigen::Dynamic, 1, 0, most, 1> multiplier = decltype(c)::Zero(4 * n);
    Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, max_device_dimension, most> HA(n, 4 * n);
    if (((A * d + c).array() >= 0).all()) return d;
    HA = factor.solve(A.transpose());
    for (int sweep = 0; sweep < 200; ++sweep) {
        double change = 0;
        for (std::ptrdiff_t i = 0; i < 4 * n; ++i) {
            const double curvature = A.row(i).dot(HA.col(i));
            if (!(curvature > 1e-300)) continue;
            const double next = std::max(0.0, multiplier[i] - (A.row(i).dot(d) + c[i]) / curvature);
            const double delta = next - multiplier[i];
            if (delta == 0) continue;
            multiplier[i] = next;
            d += delta * HA.col(i);
            change = std::max(change, std::abs(delta) * curvature);
        }
        if (change < 1e-12) break;
    }
    return d;
}

bool configuration_of(const DeviceModel& model, const Coordinates& q, Coordinates& w) {
    const DeviceKind& kind = *model.kind;
    if (kind.open_chain) return w = q, q.allFinite();
    for (int k = 0; k < 30; ++k) {
        const Joints joints = kind.joints(model, w);
        const Coordinates r = q - joints.q;
        if (r.cwiseAbs().maxCoeff() < 1e-12) return true;
        Coordinates d = joints.dq.partialPivLu().solve(r);
        if (!d.allFinite()) return false;
        const double far = d.cwiseQuotient(kind.configuration_scale).cwiseAbs().maxCoeff();
        if (far > 1) d /= far;
        w += d;
    }
    return (kind.joints(model, w).q - q).cwiseAbs().maxCoeff() < 1e-9;
}

Coordinates move_inside_limits(const DeviceModel& model, const Coordinates& w, Coordinates d) {
    if (!d.allFinite()) return w;
    for (int k = 0; k < 12; ++k, d *= 0.5) {
        Coordinates moved = w + d;
        const Joints joints = model.kind->joints(model, moved);
        if (!joints.closed || !joints.q.allFinite()) continue;
        const Coordinates q = joints.q.cwiseMax(model.joint_min).cwiseMin(model.joint_max);
        if (q == joints.q) return moved;
        if (configuration_of(model, q, moved) && inside_workspace(model, moved, 1e-9)) return moved;
    }
    return w;
}

}  // namespace palpate
