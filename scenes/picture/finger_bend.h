#pragma once
// How a finger bends behind its last bone, which is the simulated one, for pictures of the hand.

#include <Eigen/Geometry>
#include <array>

#include "engine/world.h"
#include "scenes/picture/hand.h"
#include "scenes/picture/rest_hand.h"

namespace palpate {

/// Where the last bone of a finger is.
struct LastBone {
    Eigen::Vector3d joint, tip;
    Eigen::Matrix3d axes;  ///< x distal, z dorsal
};

/// Joints before the last, where they bend naturally: the middle joint by `bend`, the last by two thirds of that.
struct NaturalJoints {
    Eigen::Vector3d middle, root, palm_along;
};
NaturalJoints natural_joints(const LastBone& last, const RestFinger& finger, double bend);
/// How far a finger bends by itself [rad]: one that points down more than one that lies flat, which is pressed from
/// above.
double usual_bend(const LastBone& last);

/// Of each bend that is tried, how deep bones would lie in objects [m^2].
constexpr int tried_bends = 26;
using BendCosts = std::array<double, tried_bends>;
/// Of the two bones before the last.
BendCosts depths_of_bends(const World& world, const LastBone& last, const RestFinger& finger);
/// The bend with which a finger's root comes nearest to where the palm has it, and bones stay out of objects [rad].
double best_bend(const LastBone& last, const RestFinger& finger, const Eigen::Isometry3d& palm,
                 const Eigen::Vector3d& root, const BendCosts& depths);
/// The middle joint between root and last joint, bent to the side where `hint` is; where that lies in objects, on the
/// side of its finger's back and of bones as much longer as lets them go around.
Eigen::Vector3d middle_joint_outside(const World& world, const Eigen::Vector3d& root, const LastBone& last,
                                     const RestFinger& finger, const Eigen::Vector3d& hint);

/// As a finger of the other hand has it.
inline Eigen::Vector3d mirrored(const Eigen::Vector3d& x, bool left) {
    return left ? Eigen::Vector3d(x.x(), -x.y(), x.z()) : x;
}
/// All bones of a hand, where its palm and the last bones of simulated fingers are; `bends` of those [rad].
HandBones bones_between(const World& world, const HandParts& parts, const Eigen::Isometry3d& palm,
                        const std::array<LastBone, 5>& last, const std::array<double, 5>& bends);

}  // namespace palpate
