#pragma once
// Force matching: the device configuration whose platform would press the pad as the virtual object does, node by node.
// Perez et al. 2017 match the shape of the contact and call its forces far too complex to compute; here the pad is
// solved against the platform, once per SIMD lane, in several configurations at once: where the last answer was, a
// little off it along each component (which gives the Jacobian), and where better ones are expected.

#include <vector>

#include "devices/matching/matching.h"
#include "engine/skin/chunks/chunk.h"

namespace palpate {

inline constexpr double platform_thickness = 0.004;  ///< more than any penetration [m]
/// Pose of the platform in the finger frame: z along its normal, out of its face, towards the pad; a body of
/// `platform_thickness` whose middle is the origin.
Pose<double> platform_pose(const DeviceModel& model, const Coordinates& w);
Shape platform_shape(const DeviceModel& model);

/// Thimble with method "force": its pad, many times. Written by match_devices; built by build_world.
struct ForceMatcher {
    std::vector<SkinChunk<float>> chunks;  ///< lanes of one chunk after the other
    SolverSettings solver;
    std::vector<Coordinates> lane_w;  ///< [lane] configuration in which it was solved
    Eigen::MatrixXd forces;           ///< [3 per sample][lane] on the pad, finger frame [N]
    Eigen::VectorXd wanted;           ///< [3 per sample] of the virtual contact [N]
    Eigen::VectorXd area;             ///< [sample] share of the rest surface [mm^2]
    Eigen::VectorXd residual, moved;  ///< [3 per sample + 4] scratch: weighted errors, of the net force, of the area
    Eigen::VectorXd weight;           ///< [sample + 2] scratch: of each error where the norm is their sum
    Eigen::MatrixXd jacobian;         ///< of the residual: [component of w, scaled], about `centre`
    Eigen::MatrixXd weighted;         ///< scratch, as jacobian
    Eigen::VectorXd centre_forces;    ///< [3 per sample] at `centre`
    Coordinates centre;
    double damping = 1e-3;
    bool warm = false;                         ///< the Jacobian is that of the last rendering step
    std::int64_t solves = 0, unconverged = 0;  ///< of lanes
};

/// `skin`: the finger at rest on the identity.
ForceMatcher build_force_matcher(const SkinParameters& skin, Material material, const DeviceModel& model,
                                 const MatchingSettings& settings);

/// Solves the pad against the platform in every lane's configuration lane_w: writes `forces`. No allocation.
void solve_pads(ForceMatcher& matcher, const DeviceModel& model);

/// Forces on the pad's nodes in the finger frame -> configuration. `geometric` is the match of the contact's shape,
/// `points`, from `previous`: what comes back is never worse, by the norm asked for, as the matcher solves the pad. No
/// allocation.
MatchingResult match_forces(ForceMatcher& matcher, const DeviceModel& model, const std::vector<MatchingPoint>& points,
                            const MatchingSettings& settings, const Coordinates& previous,
                            const MatchingResult& geometric);

}  // namespace palpate
