#pragma once
// The median hand of pictures, at rest.

#include <Eigen/Core>
#include <array>

namespace palpate {

/// Where a finger's first bone begins in the palm, its direction, and the lengths of its bones [m]. At rest fingers are
/// spread, so that there is air between their skins; at ease they lie side by side.
struct RestFinger {
    Eigen::Vector3d root, along, at_ease;
    std::array<double, 3> length;
};
/// Thumb (metacarpal, proximal, distal), index, ..., little finger (proximal, middle, distal).
const std::array<RestFinger, 5>& rest_fingers();
/// Joint of a finger at rest: 0 its root, 3 its tip [m].
Eigen::Vector3d rest_joint(int finger, int joint);

}  // namespace palpate
