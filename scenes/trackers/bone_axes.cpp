#include "scenes/trackers/bone_axes.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

namespace palpate {

namespace {

constexpr double degrees = 57.29577951308232;

/// A mistake explains what is seen where the bones agree without it as well as those of a hand that is well.
constexpr double explained_deg = 10, explained_throughout_deg = 3;
constexpr double impossible_deg = 45;

const char* remedy(BoneReading reading) {
    switch (reading) {
        case BoneReading::w_first:
            return "read with w first they agree: a joint is [x, y, z, qx, qy, qz, qw]";
        case BoneReading::inverse:
            return "conjugated they agree: rotations go from the bone's axes to the tracker's, so give qx, qy and qz "
                   "the "
                   "other sign";
        case BoneReading::plus_z:
            return "mirrored they agree: left-handed axes (as in Unity), where z, qx and qy take the other sign, or "
                   "bones "
                   "whose +z points to the tip, where -z has to";
        case BoneReading::plus_y:
            return "with +y of a bone to its tip they agree; -z has to point there, and y away from the palm";
        case BoneReading::minus_y:
            return "with -y of a bone to its tip they agree; -z has to point there, and y away from the palm";
        case BoneReading::plus_x:
            return "with +x of a bone to its tip they agree; -z has to point there, and y away from the palm";
        case BoneReading::minus_x:
            return "with -x of a bone to its tip they agree; -z has to point there, and y away from the palm";
        default:
            return "neither w first, nor conjugated, mirrored or other axes of bones explain it";
    }
}

}  // namespace

BoneAngles bone_angles(const Eigen::Vector3d& joint, const Eigen::Vector3d& tip, const Eigen::Matrix3d& axes) {
    const Eigen::Vector3d to_tip = tip - joint;
    if (!(to_tip.norm() > 0) || !to_tip.allFinite() || !axes.allFinite()) return no_bone_angles;
    BoneAngles angles;
    const auto note = [&](BoneReading reading, const Eigen::Vector3d& points) {
        const double angle = std::atan2(points.cross(to_tip).norm(), points.dot(to_tip));
        angles[std::size_t(reading)] = float(angle);
    };
    const Eigen::Quaterniond q(axes);
    // What was w, x, y, z has been read as x, y, z, w.
    const Eigen::Quaterniond w_first(q.x(), q.y(), q.z(), q.w());
    const Eigen::Vector3d x = axes.col(0), y = axes.col(1), z = axes.col(2);
    note(BoneReading::meant, -z);
    note(BoneReading::w_first, -w_first.toRotationMatrix().col(2));
    note(BoneReading::inverse, -axes.row(2).transpose());
    note(BoneReading::plus_z, z);
    note(BoneReading::plus_y, y);
    note(BoneReading::minus_y, -y);
    note(BoneReading::plus_x, x);
    note(BoneReading::minus_x, -x);
    angles[std::size_t(BoneReading::turned)] = float(2 * std::atan2(q.vec().norm(), std::abs(q.w())));
    return angles;
}

void BoneTally::add(std::span<const BoneAngles> bones) {
    std::array<float, 8> of_bones;
    bool known = false;
    for (std::size_t r = 0; r < bone_readings; ++r) {
        std::size_t n = 0;
        for (const BoneAngles& b : bones)
            if (b[r] >= 0 && n < of_bones.size()) of_bones[n++] = b[r];
        if (n == 0) continue;
        std::nth_element(of_bones.begin(), of_bones.begin() + std::ptrdiff_t(n / 2),
                         of_bones.begin() + std::ptrdiff_t(n));
        ++count_[r][std::min(bins - 1, std::size_t(of_bones[n / 2] * degrees))];
        known = true;
    }
    frames_ += known;
}

double BoneTally::median(BoneReading reading) const {
    std::int64_t below = 0;
    for (std::size_t bin = 0; bin < bins; ++bin)
        if ((below += count_[std::size_t(reading)][bin]) > frames_ / 2) return double(bin);
    return 0;
}

namespace {

BoneReading best_reading(const BoneTally& tally) {
    auto best = BoneReading::meant;
    for (std::size_t r = 0; r < std::size_t(BoneReading::turned); ++r)
        if (tally.median(BoneReading(r)) < tally.median(best)) best = BoneReading(r);
    return best;
}

}  // namespace

std::string bone_problem(const BoneTally& tally) {
    const double off = tally.median(BoneReading::meant);
    if (tally.frames() == 0 || off <= doubtful_bones_deg) return "";
    const std::string found = "rotations contradict positions: distal bones point " + std::to_string(int(off)) +
                              " degrees (median) beside their tips; ";
    if (tally.median(BoneReading::turned) < 1)
        return found + "all rotations are none ([0, 0, 0, 1]): which way nails face is not known without them";
    const BoneReading best = best_reading(tally);
    const double left = tally.median(best);
    if (best == BoneReading::meant || left > explained_deg) return found + remedy(BoneReading::meant);
    return found + remedy(best) + " (" + std::to_string(int(left)) + " degrees are left)";
}

bool bones_are_impossible(const BoneTally& tally) {
    const double off = tally.median(BoneReading::meant), left = tally.median(best_reading(tally));
    return tally.frames() > 0 &&
           (off > impossible_deg || (off > doubtful_bones_deg && left < explained_throughout_deg));
}

}  // namespace palpate
