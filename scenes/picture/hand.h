#pragma once
// The hand that fingertips belong to, for pictures alone: a median hand, posed so that its last joints are where the
// simulated bones begin. It takes no part in the simulation.

#include <Eigen/Geometry>
#include <array>
#include <vector>

#include "meshes/surface.h"
#include "scenes/run/simulation.h"

namespace palpate {

/// Bones of a hand: the palm (with wrist), then proximal, middle and distal of thumb (metacarpal, proximal, distal) to
/// little finger.
inline constexpr int hand_bone_count = 16;
inline constexpr int hand_bone(int finger, int segment) { return 1 + 3 * finger + segment; }

/// Where a bone is: rest hand -> world, with its own length.
using HandBones = std::array<Eigen::Affine3d, hand_bone_count>;

/// Skin of a right hand at rest: palm down, fingers straight along x, thumb towards y, wrist at the origin [m]. Each
/// vertex follows two bones.
struct HandSkin {
    Surface surface;
    std::vector<std::array<int, 2>> bones;  ///< [vertex]
    std::vector<double> second;             ///< [vertex] share of the second bone
};
/// Made once.
const HandSkin& hand_skin();

/// Which fingers of a scene are a hand's.
struct HandParts {
    bool left = false;
    std::array<int, 5> finger{-1, -1, -1, -1, -1};  ///< row of thumb, ..., little finger; -1: not simulated
};
/// By the names of fingers ("left index"), and by what they follow; nameless ones in the order index, middle, thumb.
std::vector<HandParts> hands_of(const Scene& scene);

/// Poses a hand again and again, each time from where it was.
class HandPoser {
  public:
    HandPoser(const Simulation& simulation, const HandParts& parts);
    const HandBones& pose(const Simulation& simulation);
    const HandParts& parts() const { return parts_; }

  private:
    HandParts parts_;
    std::array<double, 5> cut_{};   ///< x of the last joint in the bone's frame [m]
    std::array<double, 5> bend_{};  ///< of the middle joint [rad]
    Eigen::Isometry3d palm_ = Eigen::Isometry3d::Identity();
    bool posed_ = false;
    HandBones bones_;
};

/// Skin moved by its bones; mirrored where the hand is a left one (bones hold the mirror). Faces of simulated tips are
/// left out.
Surface posed_skin(const HandParts& parts, const HandBones& bones);
/// Triangles of hand_skin() that are drawn: all but those of simulated tips.
std::vector<std::array<int, 3>> drawn_faces(const HandParts& parts);

}  // namespace palpate
