#include "devices/matching/least_squares.h"

#include <array>
#include <cmath>

#include "devices/matching/small_systems.h"

namespace palpate {

namespace {

/// Whether the step keeps every joint, and the configuration, inside its limits as they are linearised.
bool stays_inside(const DeviceModel& model, const Coordinates& w, const Joints& joints, const Coordinates& d) {
    const Coordinates q = joints.q + joints.dq.lazyProduct(d), moved = w + d;
    if (!((q - model.joint_min).minCoeff() >= 0 && (model.joint_max - q).minCoeff() >= 0)) return false;
    const DeviceKind& kind = *model.kind;
    return kind.open_chain ||
           ((moved - kind.configuration_min).minCoeff() >= 0 && (kind.configuration_max - moved).minCoeff() >= 0);
}

}  // namespace

Coordinates step_inside_limits(const DeviceModel& model, const Coordinates& w, const DeviceJacobian& H,
                               const Coordinates& g) {
    const DeviceKind& kind = *model.kind;
    const int n = int(w.size());
    const Joints joints = kind.joints(model, w);
    const SmallCholesky factor(H);
    if (factor.n == 0) return Coordinates::Zero(n);
    Coordinates d = -g;
    factor.solve(d.data());
    if (stays_inside(model, w, joints, d)) return d;
    // Rows of a' d >= -c: joints above and below their limits, and the box of the search. Hildreth's method: one
    // multiplier after the other.
    struct Row {
        double a[max_device_dimension], solved[max_device_dimension];  ///< a, and H^-1 a
        double c, curvature, multiplier;
    };
    std::array<Row, 4 * max_device_dimension> rows;
    int count = 0;
    auto add = [&](auto entry, double sign, double c) {
        Row& row = rows[std::size_t(count++)];
        for (int k = 0; k < n; ++k) row.a[k] = row.solved[k] = sign * entry(k);
        factor.solve(row.solved);
        row.c = c;
        row.multiplier = row.curvature = 0;
        for (int k = 0; k < n; ++k) row.curvature += row.a[k] * row.solved[k];
    };
    for (int j = 0; j < int(joints.q.size()) && j < n; ++j) {
        const auto of_joint = [&](int k) { return joints.dq(j, k); };
        add(of_joint, 1, joints.q[j] - model.joint_min[j]);
        add(of_joint, -1, model.joint_max[j] - joints.q[j]);
    }
    for (int j = 0; j < n && !kind.open_chain; ++j) {
        const auto of_box = [&](int k) { return double(k == j); };
        add(of_box, 1, w[j] - kind.configuration_min[j]);
        add(of_box, -1, kind.configuration_max[j] - w[j]);
    }
    for (int sweep = 0; sweep < 200; ++sweep) {
        double change = 0;
        for (int i = 0; i < count; ++i) {
            Row& row = rows[std::size_t(i)];
            if (!(row.curvature > 1e-300)) continue;
            double value = row.c;
            for (int k = 0; k < n; ++k) value += row.a[k] * d[k];
            const double next = std::max(0.0, row.multiplier - value / row.curvature);
            const double delta = next - row.multiplier;
            if (delta == 0) continue;
            row.multiplier = next;
            for (int k = 0; k < n; ++k) d[k] += delta * row.solved[k];
            change = std::max(change, std::abs(delta) * row.curvature);
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
        Coordinates d = solve_square(joints.dq, r);
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
