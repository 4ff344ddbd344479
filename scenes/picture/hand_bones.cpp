#include <algorithm>
#include <cmath>

#include "scenes/picture/finger_bend.h"
#include "scenes/picture/hand.h"

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
    R.col(0) = x, R.col(1) = z.cross(x), R.col(2) = z;
    return R;
}
Vector3d rest_dorsal(int finger) { return finger == 0 ? Vector3d(-0.25, 0.55, 0.8).normalized() : Vector3d::UnitZ(); }

/// Rest hand -> world of a bone that lies from `begin` to `end` now.
Affine3d carried(int finger, int segment, const Vector3d& begin, const Vector3d& end, const Vector3d& dorsal,
                 bool left) {
    const Vector3d a = rest_joint(finger, segment), b = rest_joint(finger, segment + 1);
    const Matrix3d from = axes(b - a, rest_dorsal(finger)), to = axes(end - begin, dorsal);
    const double stretch = (end - begin).norm() / (b - a).norm();
    Affine3d T = Affine3d::Identity();
    Matrix3d scaled = to;
    scaled.col(0) *= stretch;
    if (left) scaled.col(1) *= -1;
    T.linear() = scaled.lazyProduct(from.transpose());
    T.translation() = begin - T.linear() * a;
    return T;
}

}  // namespace

HandBones bones_between(const World& world, const HandParts& parts, const Isometry3d& palm,
                        const std::array<LastBone, 5>& last, const std::array<double, 5>& bends) {
    const auto& rest = rest_fingers();
    HandBones bones;
    double mean_bend = 0, count = 0;
    for (std::size_t k = 1; k < 5; ++k)
        if (parts.finger[k] >= 0) mean_bend += bends[k], count += 1;
    mean_bend = count > 0 ? mean_bend / count : 35 * degree;
    bones[0] = palm;
    if (parts.left) bones[0].linear().col(1) *= -1;
    for (int k = 0; k < 5; ++k) {
        const RestFinger& f = rest[std::size_t(k)];
        const Vector3d root = palm * mirrored(f.root, parts.left);
        std::array<Vector3d, 4> joint{root, root, root, root};
        std::array<Vector3d, 3> dorsal;
        if (parts.finger[std::size_t(k)] >= 0) {
            const LastBone& l = last[std::size_t(k)];
            const Vector3d z = l.axes.col(2);
            joint[1] = middle_joint_outside(world, root, l, f,
                                            natural_joints(l, f, std::max(bends[std::size_t(k)], 10 * degree)).middle);
            joint[2] = l.joint;
            joint[3] = l.joint + f.length[2] * l.axes.col(0);
            dorsal = {z, z, z};
            if (k > 0) dorsal[0] = 0.5 * z + 0.5 * palm.linear().col(2);
        } else {
            // One that is not simulated stays a little straighter than its neighbours.
            const Vector3d y = palm.linear().col(1);
            const double wants = k == 0 ? 12 * degree : std::max(0.0, mean_bend - 12 * degree);
            const Vector3d along = palm.linear() * mirrored(f.at_ease, parts.left);
            double turn = k == 0 ? 0 : mean_bend > 15 * degree ? 10 * degree : -14 * degree;
            for (std::size_t b = 0; b < 3; ++b) {
                turn += b == 0 ? 0 : b == 1 ? wants : 0.6 * wants;
                const Eigen::AngleAxisd bent(turn, y);
                joint[b + 1] = joint[b] + f.length[b] * (bent * along);
                dorsal[b] = bent * (palm.linear() * mirrored(rest_dorsal(k), parts.left));
            }
        }
        for (int b = 0; b < 3; ++b)
            bones[std::size_t(hand_bone(k, b))] =
                carried(k, b, joint[std::size_t(b)], joint[std::size_t(b) + 1], dorsal[std::size_t(b)], parts.left);
    }
    return bones;
}

}  // namespace palpate
