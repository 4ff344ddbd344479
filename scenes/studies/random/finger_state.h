#pragma once
// A finger as anyone could measure it from outside: where its nodes are, and which forces it reports.

#include <array>
#include <vector>

#include "scenes/run/simulation.h"

namespace palpate {

struct FingerState {
    const Skin* skin = nullptr;
    SkinStatus status;
    std::vector<Vec3<double>> position;     ///< [node] world [m]
    std::vector<Vec3<double>> velocity;     ///< [node] from the positions of two steps [m/s]; empty in the first
    std::vector<double> mass;               ///< [node] of the skin [kg]
    std::vector<std::array<int, 3>> faces;  ///< of the surface, seen from outside
    Vec3<double> contact{0, 0, 0};          ///< sum of the reported contact forces on the skin [N]
    Vec3<double> reaction{0, 0, 0};         ///< sum of the bone's on it [N]
    Vec3<double> reaction_torque{0, 0, 0};  ///< of those about the bone's origin [N m]
    Pose<double> bone = Pose<double>::identity();
    Vec3<double> bone_velocity{0, 0, 0};  ///< from the poses of two steps [m/s]; 0 in the first
    Quaternion<double> bone_turn = Quaternion<double>::identity();  ///< in this step
    double normal_force = 0;                                        ///< reported [N]
    std::vector<ObjectContact> objects;                             ///< what it reports of each
    bool solved = false;                                            ///< neither asleep nor moved as one with its bone

    bool finite() const;
    /// Change of the skin's momentum since the step before, per time [N].
    Vec3<double> momentum_rate(const FingerState& before, double dt) const;
    /// How deep inside the tissue an object's surface lies [m], where its nearest point to a node of the pad lies
    /// straight inward; 0 where it is outside.
    double depth_under_skin(const Shape& shape, const Pose<double>& pose) const;
    /// Whether a point is inside an element, as they are now.
    bool in_tissue(const Vec3<double>& point) const;
    /// From the nearest face [m].
    double distance_to_skin(const Vec3<double>& point) const;
    /// Longest edge between two nodes of the pad, at rest [m].
    double longest_edge() const;
    /// Outward normal of a face, as long as twice its area.
    Vec3<double> area_vector(const std::array<int, 3>& face) const;
};

/// All fingers after a step; `before` gives velocities.
std::vector<FingerState> finger_states(const Simulation& simulation, const std::vector<FingerState>& before = {});

}  // namespace palpate
