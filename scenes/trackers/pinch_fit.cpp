#include "scenes/trackers/pinch_fit.h"

#include <algorithm>
#include <cmath>

#include "meshes/input_error.h"

namespace palpate {

namespace {

constexpr double closest_band = 1e-3;  ///< frames within this of the smallest gap count as the pinch [m]
constexpr double near_enough = 0.04;   ///< tips that stay farther apart do not pinch [m]

Vec3<double> tip_of(const HandFrame& frame, int finger) {
    const auto f = std::size_t(finger);
    return transform(frame.finger[f], Vec3<double>{0.5 * frame.length[f], 0, 0});
}

/// The point of a pad that is farthest along a direction: what touches a plane across it.
Vec3<double> support(const TetMesh& mesh, const Vec3<double>& direction) {
    Vec3<double> best{0, 0, 0};
    double most = -1e300;
    for (int node : mesh.pad_nodes) {
        const Vec3<double> x{mesh.nodes[node][0], mesh.nodes[node][1], mesh.nodes[node][2]};
        if (const double reach = dot(x, direction); reach > most) most = reach, best = x;
    }
    return best;
}

}  // namespace

PinchFit fit_pinch(const HandRecording& recording, const std::array<int, 2>& fingers,
                   const std::array<const TetMesh*, 2>& pads, double thickness) {
    PinchFit pinch;
    auto gap = [&](const HandFrame& f) { return norm(tip_of(f, fingers[1]) - tip_of(f, fingers[0])); };
    double least = 1e300;
    for (const HandFrame& f : recording.frames)
        if (f.valid) least = std::min(least, gap(f));
    if (!(least < near_enough))
        throw InputError(std::string(finger_names[std::size_t(fingers[0])]) + " and " +
                         finger_names[std::size_t(fingers[1])] + " do not pinch: their tips stay " +
                         std::to_string(int(1e3 * std::min(least, 1e3))) + " mm apart or more");
    // Means over the closest frames, in each finger's own frame.
    std::array<Vec3<double>, 2> middle{};
    for (const HandFrame& f : recording.frames) {
        if (!f.valid || gap(f) > least + closest_band) continue;
        if (pinch.frames++ == 0) pinch.start = f.time;
        pinch.end = f.time;
        pinch.gap += gap(f);
        const Vec3<double> tips[2] = {tip_of(f, fingers[0]), tip_of(f, fingers[1])};
        const Vec3<double> meet = 0.5 * (tips[0] + tips[1]);
        pinch.place += meet;
        for (std::size_t k : {0u, 1u}) {
            const Pose<double>& pose = f.finger[std::size_t(fingers[k])];
            pinch.direction[k] += transposed_times(rotation_matrix(pose.rotation), tips[1 - k] - tips[k]);
            middle[k] += inverse_transform(pose, meet);
        }
    }
    const double share = 1.0 / pinch.frames;
    pinch.gap *= share;
    pinch.place = share * pinch.place;
    for (std::size_t k : {0u, 1u}) {
        const double length = norm(pinch.direction[k]);
        pinch.direction[k] = length > 1e-9 ? (1 / length) * pinch.direction[k] : Vec3<double>{0, 0, -1};
        const Vec3<double>& d = pinch.direction[k];
        // A roll about x by this angle turns the pad's normal, -z, to d's part across the finger.
        const double roll = std::atan2(d.y, -d.z);
        const Quaternion<double> turn{std::cos(roll / 2), std::sin(roll / 2), 0, 0};
        const Mat3<double> R = rotation_matrix(turn);
        const Vec3<double> touching = R * support(*pads[k], transposed_times(R, d));
        pinch.fit[k] = {share * middle[k] - 0.5 * thickness * d - touching, turn};
    }
    return pinch;
}

}  // namespace palpate
