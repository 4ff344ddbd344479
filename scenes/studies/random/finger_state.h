#pragma once
// A finger as anyone could measure it from outside: where its nodes are, and which forces it reports.

#include <vector>

#include "scenes/run/simulation.h"

namespace palpate {

struct FingerState {
    const Skin* skin = nullptr;
    SkinStatus status;
    std::vector<Vec3<double>> position;  ///< [node] world [m]
    std::vector<Vec3<double>> velocity;  ///< [node] from the positions of two steps [m/s]; empty in the first
    std::vector<double> mass;            ///< [node] [kg]
    Vec3<double> contact{0, 0, 0};       ///< sum of the reported contact forces on the skin [N]
    Vec3<double> reaction{0, 0, 0};      ///< sum of the bone's on it [N]
    double normal_force = 0;             ///< reported [N]
    bool solved = false;                 ///< neither asleep nor moved as one with its bone

    bool finite() const;
    /// Change of the skin's momentum since the step before, per time [N].
    Vec3<double> momentum_rate(const FingerState& before, double dt) const;
    /// How far an object reaches into the tissue [m]: the deepest of its inside met on the way from a node of the pad
    /// to the nearest bone node, seen from the skin.
    double depth_of(const Shape& shape, const Pose<double>& pose) const;
};

/// All fingers after a step; `before` gives velocities.
std::vector<FingerState> finger_states(const Simulation& simulation, const std::vector<FingerState>& before = {});

}  // namespace palpate
