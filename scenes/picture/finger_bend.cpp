#include "scenes/picture/finger_bend.h"

#include <algorithm>
#include <cmath>

#include "engine/contact/shape.h"

namespace palpate {

namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;

constexpr double least_bend = -15 * degree, bend_step = 5 * degree;

/// The middle joint between two that are fixed, bent to the side where `hint` is; bones are stretched where they do
/// not reach.
Vector3d middle_joint(const Vector3d& root, const Vector3d& last, double first, double second, const Vector3d& hint) {
    const Vector3d span = last - root;
    const double distance = std::max(1e-4, span.norm());
    const double stretch = std::clamp(distance / (0.985 * (first + second)), 1.0, 4.0);
    first *= stretch, second *= stretch;
    const Vector3d u = span / distance;
    const double along =
        std::clamp((first * first - second * second + distance * distance) / (2 * distance), -first, first);
    Vector3d side = hint - root - (hint - root).dot(u) * u;
    if (side.norm() < 1e-5) side = u.unitOrthogonal();
    return root + along * u + std::sqrt(std::max(0.0, first * first - along * along)) * side.normalized();
}

/// How deep a bone with its skin would lie in objects: sum of squares along it [m^2]. Objects that give way are as they
/// were at rest.
double depth_of(const World& world, const Vector3d& a, const Vector3d& b) {
    constexpr double radius = 0.0085;  // of these bones with their skin [m]
    constexpr int places = 5;
    double cost = 0;
    for (int i = 1; i <= places; ++i) {
        const Vector3d x = a + double(i) / places * (b - a);
        for (const VirtualObject& o : world.shapes) {
            const double off = surface_point(o.shape, o.pose, Vec3<double>{x.x(), x.y(), x.z()}).distance;
            if (off < radius) cost += (radius - off) * (radius - off);
        }
    }
    return cost;
}

}  // namespace

NaturalJoints natural_joints(const LastBone& last, const RestFinger& f, double bend) {
    const Vector3d x = last.axes.col(0), z = last.axes.col(2);
    auto turned = [&](double angle) { return Vector3d(std::cos(angle) * x + std::sin(angle) * z); };
    const Vector3d middle = last.joint - f.length[1] * turned(0.6 * bend);
    return {middle, middle - f.length[0] * turned(1.6 * bend), turned(1.85 * bend + 5 * degree)};
}

double usual_bend(const LastBone& last) {
    return std::clamp(0.6 * std::asin(std::clamp(-last.axes(2, 0), -1.0, 1.0)) - 8 * degree, -15 * degree, 35 * degree);
}

BendCosts depths_of_bends(const World& world, const LastBone& last, const RestFinger& f) {
    BendCosts cost{};
    for (int k = 0; k < tried_bends; ++k) {
        const NaturalJoints n = natural_joints(last, f, least_bend + k * bend_step);
        cost[std::size_t(k)] = depth_of(world, last.joint, n.middle) + depth_of(world, n.middle, n.root);
    }
    return cost;
}

Vector3d middle_joint_outside(const World& world, const Vector3d& root, const LastBone& last, const RestFinger& f,
                              const Vector3d& hint) {
    Vector3d best = Vector3d::Zero();
    double least = HUGE_VAL;
    for (const Vector3d& side : {hint, Vector3d(0.5 * (root + last.joint) + 0.02 * last.axes.col(2))})
        for (double longer = 1; longer < 1.6; longer += 0.06) {
            const Vector3d middle = middle_joint(root, last.joint, longer * f.length[0], longer * f.length[1], side);
            const double cost = depth_of(world, last.joint, middle) + depth_of(world, middle, root) +
                                1e-4 * (longer - 1) * (longer - 1);
            if (cost < least) least = cost, best = middle;
        }
    return best;
}

double best_bend(const LastBone& last, const RestFinger& f, const Isometry3d& palm, const Vector3d& root,
                 const BendCosts& depth) {
    constexpr double least = least_bend, step = bend_step;
    const double usual = usual_bend(last);
    BendCosts cost{};
    for (int k = 0; k < tried_bends; ++k) {
        const double bend = least + k * step;
        const NaturalJoints n = natural_joints(last, f, bend);
        cost[std::size_t(k)] = (n.root - palm * root).squaredNorm() + 1e-4 * (bend - usual) * (bend - usual) +
                               2 * depth[std::size_t(k)] + 2e-4 * (n.palm_along - palm.linear().col(0)).squaredNorm();
    }
    const auto best = std::size_t(std::min_element(cost.begin(), cost.end()) - cost.begin());
    if (best == 0 || best == tried_bends - 1) return least + double(best) * step;
    const double before = cost[best - 1], after = cost[best + 1], curvature = before + after - 2 * cost[best];
    return least + (double(best) + (curvature > 0 ? 0.5 * (before - after) / curvature : 0)) * step;
}

}  // namespace palpate
