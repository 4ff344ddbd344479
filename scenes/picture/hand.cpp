#include "scenes/picture/hand.h"

#include <algorithm>
#include <cmath>

#include "engine/contact/shape.h"
#include "engine/math/svd3.h"
#include "scenes/picture/rest_hand.h"

namespace palpate {

namespace {

using Eigen::Affine3d;
using Eigen::Isometry3d;
using Eigen::Matrix3d;
using Eigen::Vector3d;

/// Axes of a bone: x along it, z as near to `dorsal` as that leaves.
Matrix3d axes(const Vector3d& along, const Vector3d& dorsal) {
    const Vector3d x = along.normalized();
    Vector3d z = dorsal - dorsal.dot(x) * x;
    if (z.norm() < 1e-6) z = x.unitOrthogonal();
    z.normalize();
    Matrix3d R;
    R << x, z.cross(x), z;
    return R;
}
Vector3d rest_dorsal(int finger) { return finger == 0 ? Vector3d(-0.25, 0.55, 0.8).normalized() : Vector3d::UnitZ(); }

/// Rest hand -> world of a bone that lies from `begin` to `end` now.
Affine3d carried(int finger, int segment, const Vector3d& begin, const Vector3d& end, const Vector3d& dorsal,
                 bool left) {
    const Vector3d a = rest_joint(finger, segment), b = rest_joint(finger, segment + 1);
    const Matrix3d from = axes(b - a, rest_dorsal(finger)), to = axes(end - begin, dorsal);
    const double stretch = (end - begin).norm() / (b - a).norm();
    const Vector3d scale(stretch, left ? -1 : 1, 1);
    Affine3d T = Affine3d::Identity();
    T.linear() = to * scale.asDiagonal() * from.transpose();
    T.translation() = begin - T.linear() * a;
    return T;
}

/// Where the last bone of a finger is.
struct Last {
    Vector3d joint, tip;
    Matrix3d axes;  ///< x distal, z dorsal
};

/// Joints before the last, where they bend naturally: the middle joint by `bend`, the last by two thirds of that.
struct Natural {
    Vector3d middle, root, palm_along;
};
Natural natural(const Last& last, const RestFinger& f, double bend) {
    const Vector3d x = last.axes.col(0), z = last.axes.col(2);
    auto turned = [&](double angle) { return Vector3d(std::cos(angle) * x + std::sin(angle) * z); };
    const Vector3d middle = last.joint - f.length[1] * turned(0.6 * bend);
    return {middle, middle - f.length[0] * turned(1.6 * bend), turned(1.85 * bend + 5 * degree)};
}

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

/// Turn that brings directions and places of the palm nearest to where fingers want them.
struct Fit {
    Matrix3d covariance = Matrix3d::Zero();
    Vector3d rest_mean = Vector3d::Zero(), now_mean = Vector3d::Zero();
    double weight = 0;
    std::vector<std::array<Vector3d, 2>> places;
    std::vector<double> weights;
    void place(const Vector3d& rest, const Vector3d& now, double w) {
        places.push_back({rest, now}), weights.push_back(w);
        rest_mean += w * rest, now_mean += w * now, weight += w;
    }
    void direction(const Vector3d& rest, const Vector3d& now, double w) { covariance += w * now * rest.transpose(); }
    Isometry3d solve() {
        rest_mean /= weight, now_mean /= weight;
        for (std::size_t k = 0; k < places.size(); ++k)
            covariance += weights[k] * (places[k][1] - now_mean) * (places[k][0] - rest_mean).transpose();
        Mat3<double> C;
        for (int i = 0; i < 9; ++i) C.m[i / 3][i % 3] = covariance(i / 3, i % 3);
        const SignedSvd<double> svd = signed_svd(C);  // not Eigen's, which takes ten seconds to compile
        const Mat3<double> R = times_transposed(svd.U, svd.V);
        Isometry3d T = Isometry3d::Identity();
        for (int i = 0; i < 9; ++i) T.linear()(i / 3, i % 3) = R.m[i / 3][i % 3];
        T.translation() = now_mean - T.linear() * rest_mean;
        return T;
    }
};

/// How far a finger bends by itself: one that points down more than one that lies flat, which is pressed from above.
double usual_bend(const Last& last) {
    return std::clamp(0.6 * std::asin(std::clamp(-last.axes(2, 0), -1.0, 1.0)) - 8 * degree, -15 * degree, 35 * degree);
}

/// Bends that are tried.
constexpr int tries = 26;
constexpr double least_bend = -15 * degree, bend_step = 5 * degree;
using BendCosts = std::array<double, tries>;

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

/// Of each bend, how deep the two bones before the last would lie.
BendCosts depths(const World& world, const Last& last, const RestFinger& f) {
    BendCosts cost{};
    for (int k = 0; k < tries; ++k) {
        const Natural n = natural(last, f, least_bend + k * bend_step);
        cost[std::size_t(k)] = depth_of(world, last.joint, n.middle) + depth_of(world, n.middle, n.root);
    }
    return cost;
}

/// The middle joint as middle_joint() has it, where that lies in objects on the side of its finger's back and of bones
/// as much longer as lets them go around.
Vector3d middle_joint_outside(const World& world, const Vector3d& root, const Last& last, const RestFinger& f,
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

/// The bend with which a finger's root comes nearest to where the palm has it, and bones stay out of objects.
double best_bend(const Last& last, const RestFinger& f, const Isometry3d& palm, const Vector3d& root,
                 const BendCosts& depth) {
    constexpr double least = least_bend, step = bend_step;
    const double usual = usual_bend(last);
    BendCosts cost{};
    for (int k = 0; k < tries; ++k) {
        const double bend = least + k * step;
        const Natural n = natural(last, f, bend);
        cost[std::size_t(k)] = (n.root - palm * root).squaredNorm() + 1e-4 * (bend - usual) * (bend - usual) +
                               2 * depth[std::size_t(k)] + 2e-4 * (n.palm_along - palm.linear().col(0)).squaredNorm();
    }
    const auto best = std::size_t(std::min_element(cost.begin(), cost.end()) - cost.begin());
    if (best == 0 || best == tries - 1) return least + double(best) * step;
    const double before = cost[best - 1], after = cost[best + 1], curvature = before + after - 2 * cost[best];
    return least + (double(best) + (curvature > 0 ? 0.5 * (before - after) / curvature : 0)) * step;
}

Vector3d mirrored(Vector3d x, bool left) { return left ? Vector3d(x.x(), -x.y(), x.z()) : x; }

}  // namespace

const std::array<RestFinger, 5>& rest_fingers() {
    const auto towards = [](double x, double y, double z) { return Vector3d(x, y, z).normalized(); };
    static const std::array<RestFinger, 5> fingers{{
        {{0.024, 0.024, -0.010}, towards(0.74, 0.62, -0.26), towards(0.74, 0.62, -0.26), {0.045, 0.033, 0.027}},
        {{0.090, 0.025, 0.001}, towards(1, 0.24, 0), towards(1, 0.10, 0), {0.044, 0.025, 0.022}},
        {{0.093, 0.004, 0.003}, towards(1, 0.04, 0), towards(1, 0.01, 0), {0.049, 0.029, 0.023}},
        {{0.087, -0.016, 0.001}, towards(1, -0.16, 0), towards(1, -0.08, 0), {0.045, 0.028, 0.023}},
        {{0.077, -0.034, -0.003}, towards(1, -0.38, 0), towards(1, -0.18, 0), {0.035, 0.020, 0.021}},
    }};
    return fingers;
}
/// Joint of a finger at rest: 0 its root, 3 its tip.
Vector3d rest_joint(int finger, int joint) {
    const RestFinger& f = rest_fingers()[std::size_t(finger)];
    Vector3d x = f.root;
    for (int k = 0; k < joint; ++k) x += f.length[std::size_t(k)] * f.along;
    return x;
}

std::vector<HandParts> hands_of(const Scene& scene) {
    std::vector<HandParts> hands;
    for (std::size_t row = 0; row < scene.spec.fingers.size(); ++row) {
        const FingerMotion* motion = row < scene.finger_motions.size() ? &scene.finger_motions[row] : nullptr;
        std::string name = scene.spec.fingers[row].name;
        for (char& c : name) c = char(std::tolower(static_cast<unsigned char>(c)));
        const bool follows = motion && motion->followed_finger >= 0;
        const bool left = name.find("left") != std::string::npos || (follows && motion->hand == 0);
        std::vector<int> slots;
        if (follows) slots.push_back(motion->followed_finger);
        for (int k = 0; k < 5; ++k)
            if (name.find(finger_names[std::size_t(k)]) != std::string::npos) slots.push_back(k);
        if (slots.empty()) slots = {1, 2, 0, 3, 4};
        auto takes = [&](const HandParts& h, int slot) { return h.left == left && h.finger[std::size_t(slot)] < 0; };
        bool placed = false;
        for (HandParts& hand : hands)
            for (const int slot : slots)
                if (!placed && takes(hand, slot)) hand.finger[std::size_t(slot)] = int(row), placed = true;
        if (placed) continue;
        hands.push_back({left, {-1, -1, -1, -1, -1}});
        hands.back().finger[std::size_t(slots[0])] = int(row);
    }
    return hands;
}

HandPoser::HandPoser(const Simulation& s, const HandParts& parts) : parts_(parts) {
    bend_.fill(35 * degree);
    for (std::size_t k = 0; k < 5; ++k) {
        if (parts.finger[k] < 0) continue;
        const TetMesh& mesh = s.world.skins.find(s.fingers[std::size_t(parts.finger[k])])->mesh;
        cut_[k] = bounds(mesh.nodes)[0][0];
    }
}

const HandBones& HandPoser::pose(const Simulation& s) {
    const auto& rest = rest_fingers();
    std::array<Last, 5> last;
    std::array<BendCosts, 5> depth{};
    for (std::size_t k = 0; k < 5; ++k) {
        if (parts_.finger[k] < 0) continue;
        const Pose<double> bone = bone_pose(s.world, s.fingers[std::size_t(parts_.finger[k])]);
        const Eigen::Quaterniond q(bone.rotation.w, bone.rotation.x, bone.rotation.y, bone.rotation.z);
        const Vector3d at(bone.position.x, bone.position.y, bone.position.z);
        last[k].axes = q.normalized().toRotationMatrix();
        last[k].joint = at + cut_[k] * last[k].axes.col(0);
        last[k].tip = at;
        depth[k] = depths(s.world, last[k], rest[k]);
    }
    if (!posed_)
        for (std::size_t k = 0; k < 5; ++k)
            if (parts_.finger[k] >= 0) bend_[k] = usual_bend(last[k]);
    // Palm and bends by turns: each bend is best for the palm, the palm for all bends.
    for (int turn = 0; turn < (posed_ ? 6 : 40); ++turn) {
        Fit fit;
        for (int k = 0; k < 5; ++k) {
            if (parts_.finger[std::size_t(k)] < 0) continue;
            const Natural n = natural(last[std::size_t(k)], rest[std::size_t(k)], bend_[std::size_t(k)]);
            fit.place(mirrored(rest[std::size_t(k)].root, parts_.left), n.root, k == 0 ? 0.3 : 1);
            if (k == 0) continue;
            fit.direction(Vector3d::UnitX(), n.palm_along, 1e-3);
            fit.direction(Vector3d::UnitY(), last[std::size_t(k)].axes.col(1), 5e-4);
        }
        const bool thumb_alone = fit.places.size() == 1 && parts_.finger[0] >= 0;
        if (thumb_alone) {  // its nail looks away from the fingers
            fit.direction(Vector3d::UnitX(), last[0].axes.col(0), 1e-3);
            fit.direction(mirrored({0, 1, 0}, parts_.left), last[0].axes.col(2), 5e-4);
        }
        palm_ = fit.solve();
        for (int k = 0; k < 5; ++k)
            if (parts_.finger[std::size_t(k)] >= 0)
                bend_[std::size_t(k)] =
                    best_bend(last[std::size_t(k)], rest[std::size_t(k)], palm_,
                              mirrored(rest[std::size_t(k)].root, parts_.left), depth[std::size_t(k)]);
    }
    posed_ = true;
    double mean_bend = 0, count = 0;
    for (std::size_t k = 1; k < 5; ++k)
        if (parts_.finger[k] >= 0) mean_bend += bend_[k], count += 1;
    mean_bend = count > 0 ? mean_bend / count : 35 * degree;
    bones_[0] = palm_ * Eigen::Scaling(1.0, parts_.left ? -1.0 : 1.0, 1.0);
    for (int k = 0; k < 5; ++k) {
        const RestFinger& f = rest[std::size_t(k)];
        const Vector3d root = palm_ * mirrored(f.root, parts_.left);
        std::array<Vector3d, 4> joint{root, root, root, root};
        std::array<Vector3d, 3> dorsal;
        if (parts_.finger[std::size_t(k)] >= 0) {
            const Last& l = last[std::size_t(k)];
            const Vector3d z = l.axes.col(2);
            joint[1] = middle_joint_outside(s.world, root, l, f,
                                            natural(l, f, std::max(bend_[std::size_t(k)], 10 * degree)).middle);
            joint[2] = l.joint;
            joint[3] = l.joint + f.length[2] * l.axes.col(0);
            dorsal = {z, z, z};
            if (k > 0) dorsal[0] = 0.5 * z + 0.5 * palm_.linear().col(2);
        } else {
            // One that is not simulated stays a little straighter than its neighbours.
            const Vector3d y = palm_.linear().col(1);
            const double wants = k == 0 ? 12 * degree : std::max(0.0, mean_bend - 12 * degree);
            const Vector3d along = palm_.linear() * mirrored(f.at_ease, parts_.left);
            double turn = k == 0 ? 0 : mean_bend > 15 * degree ? 10 * degree : -14 * degree;
            for (std::size_t b = 0; b < 3; ++b) {
                turn += b == 0 ? 0 : b == 1 ? wants : 0.6 * wants;
                const Eigen::AngleAxisd bent(turn, y);
                joint[b + 1] = joint[b] + f.length[b] * (bent * along);
                dorsal[b] = bent * (palm_.linear() * mirrored(rest_dorsal(k), parts_.left));
            }
        }
        for (int b = 0; b < 3; ++b)
            bones_[std::size_t(hand_bone(k, b))] =
                carried(k, b, joint[std::size_t(b)], joint[std::size_t(b) + 1], dorsal[std::size_t(b)], parts_.left);
    }
    return bones_;
}

}  // namespace palpate
