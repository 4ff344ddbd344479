#include "scenes/picture/hand.h"

#include <algorithm>
#include <cmath>

#include "engine/math/svd3.h"
#include "scenes/picture/finger_bend.h"
#include "scenes/picture/rest_hand.h"

namespace palpate {

namespace {

using Eigen::Affine3d;
using Eigen::Isometry3d;
using Eigen::Matrix3d;
using Eigen::Vector3d;

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
    std::array<LastBone, 5> last{};
    std::array<BendCosts, 5> depth{};
    for (std::size_t k = 0; k < 5; ++k) {
        if (parts_.finger[k] < 0) continue;
        const Pose<double> bone = bone_pose(s.world, s.fingers[std::size_t(parts_.finger[k])]);
        const Eigen::Quaterniond q(bone.rotation.w, bone.rotation.x, bone.rotation.y, bone.rotation.z);
        const Vector3d at(bone.position.x, bone.position.y, bone.position.z);
        last[k].axes = q.normalized().toRotationMatrix();
        last[k].joint = at + cut_[k] * last[k].axes.col(0);
        last[k].tip = at;
        depth[k] = depths_of_bends(s.world, last[k], rest[k]);
    }
    if (!posed_)
        for (std::size_t k = 0; k < 5; ++k)
            if (parts_.finger[k] >= 0) bend_[k] = usual_bend(last[k]);
    // Palm and bends by turns: each bend is best for the palm, the palm for all bends.
    for (int turn = 0; turn < (posed_ ? 6 : 40); ++turn) {
        Fit fit;
        for (int k = 0; k < 5; ++k) {
            if (parts_.finger[std::size_t(k)] < 0) continue;
            const NaturalJoints n = natural_joints(last[std::size_t(k)], rest[std::size_t(k)], bend_[std::size_t(k)]);
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
    bones_ = bones_between(s.world, parts_, palm_, last, bend_);
    return bones_;
}

}  // namespace palpate
