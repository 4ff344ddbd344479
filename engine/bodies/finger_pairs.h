#pragma once
// Soft fingers against each other. Between two fingers that are near lies a plane without mass; each presses on its own
// side of it, with friction, as on a body, and the plane's pose is an unknown of the solve as a body's is. What the two
// press it with is then action and reaction, forces and torques, whichever of them is stiffer or finer: neither is the
// other's obstacle. Between two bodies that bulge alike the surface of contact is flat; where they do not, it is taken
// as flat.

#include <vector>

#include "engine/bodies/rigid_body.h"
#include "engine/skin/chunks/chunk.h"

namespace palpate {

/// Two fingers near each other, and the plane between them; its z axis points to `a`.
struct FingerPair {
    int a = -1, b = -1;                             ///< rows of fingers, a < b
    Pose<double> start = Pose<double>::identity();  ///< of the plane, at the beginning of the step
    Pose<double> pose = Pose<double>::identity();   ///< and at its end
    Vec3<double> centre{0, 0, 0};                   ///< of what presses on it, at the end
    bool touching = false;                          ///< something presses on it
    bool touched = false;                           ///< and did in the step before
};

/// A sample of one of a pair's fingers, as balance_planes sees it.
struct PlaneSample {
    bool of_b = false;
    bool holds = false;                        ///< has a multiplier, or a friction that may act
    std::size_t number = 0;                    ///< in the arrays of its chunk: [slot][sample][lane]
    Vec3<double> x{0, 0, 0}, before{0, 0, 0};  ///< now, world; at the start of the step, in the plane's frame
    double normal_multiplier = 0, offset = 0, k = 0, k_slip = 0, friction_radius = 0;
    Vec3<double> tangential_multiplier{0, 0, 0}, friction_normal{0, 0, 0};  ///< plane's frame
    Vec3<double> gradient{0, 0, 0}, first_gradient{0, 0, 0};                ///< before the plane was moved
};

struct FingerPairs {
    bool on = false;                         ///< fingers touch each other
    double friction = 0;                     ///< Coulomb coefficient of skin on skin
    std::vector<FingerPair> near;            ///< in this step, by their fingers' rows
    std::vector<FingerPair> before;          ///< those whose reaches met in the last one, near or not
    std::vector<Sphere> reach;               ///< scratch: [finger]
    std::vector<int> order;                  ///< scratch: fingers from low to high x
    std::vector<int> slot;                   ///< scratch: [finger] next one to be filled
    std::vector<Vec3<double>> pad_a, pad_b;  ///< scratch: samples of two fingers, world
    std::vector<PlaneSample> samples;        ///< scratch
};

/// The plane as a finger sees it that is on its z side, or on the other.
inline Pose<double> plane_side(const Pose<double>& plane, bool of_b) {
    return of_b ? Pose<double>{plane.position, plane.rotation * Quaternion<double>{0, 1, 0, 0}} : plane;
}

}  // namespace palpate
