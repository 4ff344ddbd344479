#pragma once
// Contact surface matching (Perez et al. 2017, Eqs. 1-5): the device configuration whose platform
// touches the pad where the virtual object does.

#include <string>
#include <vector>

#include "devices/device.h"

namespace palpate {

/// One pad sample as the matching sees it.
struct MatchingPoint {
    Eigen::Vector3d position;  ///< deformed, device frame [m]
    bool touches = false;      ///< in C_O (true) or N_O (false)
    double weight = 1;         ///< of its distance in Eq. 3: samples of a mesh stand for areas of different size
};

/// Distance of a point to the platform, with derivatives with respect to its centre and normal.
struct DiskDistance {
    double value;  ///< [m]
    Eigen::Vector3d dcentre, dnormal;
};

/// Unsigned distance to the disk: to its interior or its rim.
DiskDistance disk_distance(const Eigen::Vector3d& x, const Platform& platform, double radius);

/// Signed distance to the disk extended as a truncated cone of 90 degrees behind it (interior, rim,
/// cone); negative inside.
DiskDistance cone_distance(const Eigen::Vector3d& x, const Platform& platform, double radius);

/// How the constrained problem is solved.
enum class MatchingSolver {
    slsqp,          ///< NLopt
    least_squares,  ///< damped Gauss-Newton on the distances
    multistart      ///< least squares from many places: slow, and the reference that says how local the others are
};

/// What force matching minimises of its errors: of each node's force, of the net force, of the area.
enum class ForceNorm {
    squares,  ///< sum of |F_i - Fbar_i|^2
    sum       ///< sum of |F_i - Fbar_i|, which forgives what no pose can render in a few nodes
};

struct MatchingSettings {
    MatchingSolver solver = MatchingSolver::slsqp;
    double tolerance = 1e-4;  ///< relative change of the scaled configuration at which SLSQP stops
    int evaluations = 100;    ///< most evaluations of the objective
    double smoothing = 0;     ///< weight of the distance from the last configuration [mm^2]
    bool non_contact = true;  ///< include N_O (Eq. 3's second sum)
    double joint_speed = 0;   ///< fastest that a joint may move from one match to the next [rad/s]; 0: as it likes
    int sideways_starts = 8;  ///< searches beside the contact, of platforms that can slide along themselves
    // Of the method "force" (engine/thimbles/force_matching.h):
    int force_rounds = 1;      ///< solves of the pad, in all lanes at once, per rendering step
    int force_iterations = 3;  ///< most Newton iterations of each
    ForceNorm force_norm = ForceNorm::squares;
    double normal_weight = 1;      ///< of errors of the nodes' forces along the wanted net force
    double tangential_weight = 1;  ///< of those across it
    double net_weight = 0;         ///< of the net force's error against that of the nodes' forces
    double area_weight = 0;        ///< of the touching area's error [N^2/mm^4, as the norm has it]
};

struct MatchingObjective {
    double value;          ///< f(w) [mm^2]
    Coordinates gradient;  ///< df/dw [mm^2 per rad or m]
};

/// Eq. 3 with the gradient of Eqs. 4 and 5, plus temporal smoothing about `previous`.
MatchingObjective matching_objective(const DeviceModel& model, const std::vector<MatchingPoint>& points,
                                     const MatchingSettings& settings, const Coordinates& previous,
                                     const Coordinates& w);

enum class MatchingMethod { constrained, unconstrained, plane, force };
enum class MatchingStatus {
    matched,     ///< solved
    no_contact,  ///< nothing touches: the rest configuration
    budget,      ///< evaluations spent; best feasible configuration kept
    kept,        ///< no better feasible configuration was found; the last one is kept
};

struct MatchingResult {
    Coordinates w, q;
    MatchingStatus status = MatchingStatus::kept;
    double residual = 0;  ///< f(w) at the result [mm^2]
    double rms_m = 0;     ///< root of the mean squared distance of touching points to the disk [m]
    int evaluations = 0;
    bool constraint_active = false;  ///< a joint is at its limit
    double force_residual_N = 0;     ///< root of the sum of squares, or the sum, of weighted errors of forces
};

/// Fills in what follows from a result's configuration w: joints, objective, distance to what it should touch, and
/// whether a joint is at its limit.
void judge(const DeviceModel& model, const std::vector<MatchingPoint>& points, const MatchingSettings& settings,
           const Coordinates& previous, MatchingResult& result);

/// Eq. 2: minimise f over w subject to C(q(w)) >= 0, from the warm start `previous`.
MatchingResult match_constrained(const DeviceModel&, const std::vector<MatchingPoint>&, const MatchingSettings&,
                                 const Coordinates& previous);
/// Minimise f without joint limits, then project onto the workspace.
MatchingResult match_unconstrained(const DeviceModel&, const std::vector<MatchingPoint>&, const MatchingSettings&,
                                   const Coordinates& previous);
/// Plane of least squares through C_O, then project onto the workspace.
MatchingResult match_plane(const DeviceModel&, const std::vector<MatchingPoint>&, const MatchingSettings&,
                           const Coordinates& previous);
/// One of the three; for `force` the constrained match, from which it starts.
MatchingResult match(MatchingMethod, const DeviceModel&, const std::vector<MatchingPoint>&, const MatchingSettings&,
                     const Coordinates& previous);

/// The device as it is for one match when no joint may move farther than `joint_step` from where it is at `from`: joint
/// limits that near, and a rest configuration as far towards the real one as they allow.
DeviceModel within_a_step(const DeviceModel& model, const Coordinates& from, double joint_step);

/// The reachable configuration nearest to w, in scaled coordinates.
Coordinates project_to_workspace(const DeviceModel& model, const Coordinates& w);

/// Method by name ("constrained", "unconstrained", "plane", "force"); false if there is none.
bool parse_method(const std::string& name, MatchingMethod& method);

}  // namespace palpate
