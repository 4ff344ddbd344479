#pragma once
// Whether rotations of a tracked hand agree with places of its joints: a distal bone points to its tip. Where it does
// not, which of the usual mistakes would explain it.

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <span>
#include <string>

namespace palpate {

/// Ways to read a rotation. The first is the one that is meant: x, y, z, w, from the bone's axes to the tracker's, -z
/// to the tip. `turned` is none, but how far it is from no rotation at all.
enum class BoneReading : std::size_t { meant, w_first, inverse, plus_z, plus_y, minus_y, plus_x, minus_x, turned };
inline constexpr std::size_t bone_readings = 9;

/// Per reading, the angle between where a bone's rotation says that it points, and its tip [rad]; below 0 where joint
/// and tip are one place.
using BoneAngles = std::array<float, bone_readings>;
inline constexpr BoneAngles no_bone_angles{-1, -1, -1, -1, -1, -1, -1, -1, -1};

/// Of one bone, from `joint` to `tip`, with its axes in columns (x sideways, y dorsal, z proximal), all in the
/// tracker's own axes, for mistakes are made in those.
BoneAngles bone_angles(const Eigen::Vector3d& joint, const Eigen::Vector3d& tip, const Eigen::Matrix3d& axes);

/// What frames of a hand have in common.
class BoneTally {
  public:
    /// The bones of one frame: the median of them counts.
    void add(std::span<const BoneAngles> bones);
    std::int64_t frames() const { return frames_; }
    /// Median over all frames [degrees], to half a degree.
    double median(BoneReading reading) const;

  private:
    static constexpr std::size_t bins = 181;  ///< a degree each
    std::array<std::array<std::int64_t, bins>, bone_readings> count_{};
    std::int64_t frames_ = 0;
};

/// Trackers of hands that are well give 0 to a few degrees.
inline constexpr double doubtful_bones_deg = 20;
/// What is wrong with rotations, and how it would be right, as a sentence about "distal bones"; empty where they agree,
/// or where there are no frames.
std::string bone_problem(const BoneTally& tally);
/// Whether no hand can have been like that: no finger's last bone points so far beside its own tip, or a mistake
/// explains it throughout.
bool bones_are_impossible(const BoneTally& tally);

}  // namespace palpate
