#pragma once
// Work memory of the bodies' solve (solve_bodies.cpp). Empty in scenes without bodies.

#include <vector>

#include "engine/bodies/body_contact.h"
#include "engine/skin/progress.h"

namespace palpate {

/// A body within a step.
struct BodyProgress {
    Pose<double> start, target, base, pose;  ///< of the centre of mass
    Motion gradient = Motion::Zero(), rhs = Motion::Zero(), step = Motion::Zero(), added = Motion::Zero();
    Motion first_step = Motion::Zero();
    BodyTerms inertia;
    int island = -1, row = 0;  ///< row: of its 6 unknowns in the island's matrix
};

/// Lanes and bodies that touch each other, directly or through others: they iterate as one.
struct Island {
    Evaluation<double> evaluation;
    detail::LaneProgress<double> progress;
    detail::LaneDecision<double> decision;
    double rounding = 0, surprise = 0, slope = 0, first_slope = 0, bad_pivots = 0;
    bool following = false;
    bool left_linear = false;  ///< its matrix was not positive definite with linear tissue
    std::vector<int> bodies;   ///< rows
};

struct BodySolve {
    std::vector<std::vector<Feature>> features;  ///< [object]
    std::vector<double> reach;                   ///< [object] radius of its bounding sphere; huge for a plane [m]
    std::vector<ContactBody> objects;            ///< [object]
    std::vector<BodyPair> pairs;                 ///< [object with features][partner]
    int partners = 0;                            ///< pairs per object
    std::vector<BodyProgress> bodies;            ///< [body]
    std::vector<int> parent;                     ///< union-find over bodies, then lanes
    std::vector<int> lane_island;                ///< [coupled chunk][16]
    std::vector<int> coupled;                    ///< chunks near a body: doubles, then floats
    std::vector<Island> islands;
    int island_count = 0;
    Eigen::MatrixXd matrix;  ///< of the largest island
    Eigen::VectorXd rhs;
};

}  // namespace palpate
