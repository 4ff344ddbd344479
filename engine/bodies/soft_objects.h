#pragma once
// Objects of tissue. A soft object is a skin of its own: its fixed nodes are its bone, which is held at the object's
// pose. Fingers touch it sample by sample: each sample of a finger presses on the nearest face of the object's surface
// as it is deformed, and the face's nodes bear the reaction, so that action equals reaction whatever the solve has
// reached. Both are unknowns of one solve (soft_contact.h).

#include <Eigen/Core>
#include <vector>

#include "engine/contact/contact_terms.h"
#include "engine/skin/chunks/chunk.h"

namespace palpate {

/// Nodes of a lane, and their shares of a point between them.
struct Stencil {
    int count = 0;
    std::array<int, 3> node{};
    std::array<double, 3> weight{};
    std::array<int, 6> block{};  ///< of the node pairs 00, 10, 11, 20, 21, 22; -1: with a node of the bone
};

/// A sample of a finger against the nearest face of a soft object. Vectors are in the world's frame, forces and
/// gradients are the sample's.
struct SoftSample {
    bool near = false;                             ///< in this step
    Stencil of_finger, of_face;                    ///< written by detect_soft_pairs
    Vec3<double> normal{0, 0, 1};                  ///< of the surface there, outward; kept through the step
    Vec3<double> finger_start, face_start;         ///< where the two points were when the step began [m]
    ContactState<double> state{0, {}, 0, {}};      ///< multipliers
    double gap = 0;                                ///< at the last evaluation [m]
    double slip = 0;                               ///< way over the surface in this step, then [m]
    bool idle = true;                              ///< bears nothing, and did not at the last multiplier update
    ContactTerms<double> terms{0, {}, {}, 0, {}};  ///< at the last evaluation; at the end of a step: its contact
};

/// A finger and a soft object.
struct SoftPair {
    int finger = -1, soft = -1;       ///< rows of fingers and of soft objects
    double friction = 0;              ///< Coulomb coefficient
    bool near = false;                ///< in this step
    int island = -1;                  ///< in this step, of both; -1: not solved
    std::vector<SoftSample> samples;  ///< [sample of the finger]
};

/// Vectors over all unknowns of an island, for its coupled direction.
struct SoftWork {
    std::vector<int> first;  ///< [coupled chunk][16] a lane's first number; -1: of another island
    Eigen::VectorXd wanted, residual, solved, search, image, whole_image, direction;
};

}  // namespace palpate
