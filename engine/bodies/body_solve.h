#pragma once
// Work memory of the bodies' solve (solve_bodies.cpp). Empty in scenes without bodies, until fingers come near each
// other.

#include <vector>

#include "engine/bodies/body_contact.h"
#include "engine/skin/chunks/step_cut.h"
#include "engine/skin/solve/lane_progress.h"

namespace palpate {

/// A body within a step.
struct BodyProgress {
    Pose<double> start, target, base, pose;  ///< of the centre of mass
    Motion gradient = Motion::Zero(), rhs = Motion::Zero(), step = Motion::Zero(), added = Motion::Zero();
    Motion first_step = Motion::Zero();
    BodyTerms inertia;
    Vec3<double> velocity_before{0, 0, 0}, momentum_before{0, 0, 0};        ///< of the step's start: linear, angular
    Vec3<double> velocity_unbounced{0, 0, 0}, momentum_unbounced{0, 0, 0};  ///< of its end, before bounces
    double kinetic = 0;                                                     ///< energy, when the step began [J]
    Vec3<double> weight{0, 0, 0};                                           ///< [N]
    double gain = 0, supported = 0;  ///< energy that contacts gave it in this step, and what they may have given [J]
    double load = 0;                 ///< sum of the forces of contacts [N]
    double worked = 0;               ///< sum of what contacts gave and took [J]
    double undone = 0;               ///< of its overlaps with objects at the start of the step, the most [m]
    Vec3<double> carried{0, 0, 0};   ///< way of what they belong to, times those forces [m N]
    bool flies = false;              ///< near nothing in this step
    // In static equilibrium (anchors.h):
    Pose<double> anchor;               ///< of the centre of mass
    double anchor_time = 0;            ///< it holds as inertia in steps of this length would [s]
    double borne = 0, last_borne = 0;  ///< what it bears now, and bore before it was last cast [weights]
    int vain_casts = 0;                ///< in a row, after which it bore as much as before
    bool adrift = false;               ///< nothing else bears the body
    int island = -1, row = 0;          ///< row: of its 6 unknowns in the island's matrix
};

/// Lanes and bodies that touch each other, directly or through others: they iterate as one.
struct Island {
    Evaluation<double> evaluation;
    detail::LaneProgress<double> progress;
    detail::LaneDecision<double> decision;
    double rounding = 0, contact_residual = 0, slope = 0, first_slope = 0, bad_pivots = 0;
    int vain_updates = 0;  ///< in a row, that left the deepest overlap as it was
    bool following = false;
    bool soft = false;        ///< some lane is near a soft object
    bool recovers = false;    ///< scratch: an overlap has been undone in it
    bool anchored = false;    ///< scratch: something that is no body may have pushed it
    bool driven = false;      ///< scratch: something that moves by a track may touch its bodies
    bool settling = false;    ///< scratch: impulses still change speeds of its bodies
    double speed_change = 0;  ///< scratch: by how much, in one sweep [m/s]
    bool slow = false;        ///< a kept matrix has led it hardly nearer to the solution (kept_matrix.h)
    bool coupling = false;    ///< scratch: its coupled direction is being found
    bool linear = false;      ///< some lane has linear tissue
    bool unbound = false;     ///< its matrix was not positive definite with linear tissue
    double stiffness = 0;     ///< of the tissue of its lanes, the largest: scale of damping [N/m]; 0 without lanes
    std::vector<int> bodies;  ///< rows; those of planes between fingers come after all bodies
};

/// Two objects, one inside the other where a step began.
struct ObjectOverlap {
    int a = -1, b = -1;  ///< rows; -1: none
    double depth = 0;    ///< [m]
    double time = 0;     ///< since the start [s]
};

struct BodySolve {
    std::vector<std::vector<Feature>> features, plane_features;  ///< [object] against others, against planes
    std::vector<double> reach;         ///< [object] radius of its bounding sphere; huge for a plane [m]
    std::vector<ContactBody> objects;  ///< [object]
    std::vector<BodyPair> pairs;       ///< by the object that brings the features
    std::vector<int> first_pair;       ///< [object, end] its places in `pairs`
    std::vector<int> wanted_pairs;     ///< [object] how many it is near to
    std::vector<int> near_objects;     ///< scratch: [found] rows of objects that one may touch in this step
    ObjectOverlap deepest;             ///< of all steps
    std::vector<BodyProgress> bodies;  ///< [body, plane between fingers]
    int places = 0;                    ///< bodies and planes for which there is memory
    std::vector<int> parent;           ///< union-find over bodies, then lanes
    std::vector<int> lane_island;      ///< [coupled chunk][16]
    /// Fingers (and soft objects) of islands by their numbers, with their places in lane_island: sums over them do not
    /// depend on the chunks that they are in.
    std::vector<std::pair<int, int>> fingers;
    std::vector<int> coupled;     ///< chunks near a body: doubles, then floats
    std::vector<Island> islands;  ///< the last is that of sleeping bodies
    int island_count = 0;
    StepCut cut;
    Eigen::MatrixXd matrix;  ///< of the largest island
    Eigen::VectorXd rhs;
};

/// Those that a pair's `a` brings.
inline const std::vector<Feature>& features_of_pair(const BodySolve& s, const BodyPair& p) {
    const bool plane = s.objects[std::size_t(p.b)].shape->kind == ShapeKind::plane;
    return (plane ? s.plane_features : s.features)[std::size_t(p.a)];
}

}  // namespace palpate
