#include "engine/thimbles/force_matching.h"

#include <algorithm>
#include <cmath>

#include "devices/matching/fitted.h"
#include "devices/matching/least_squares.h"
#include "engine/skin/solve/solve_skin.h"
#include "engine/thimbles/fitted.h"

namespace palpate {

namespace {

using fitted::lanes_wanted, fitted::difference;

int lane_count(const ForceMatcher& m) { return int(m.lane_w.size()); }

/// Bone held at the identity, stiffly: the platform moves, the finger does not.
template <class T>
void hold_bone(SkinChunk<T>& c) {
    const double springs[3][9] = {
        {1e6, 1e3, 0, 0, 0, 1, 0, 0, 0}, {0, 0, 0, 0, 0, 1, 0, 0, 0}, {0, 0, 0, 0, 0, 1, 0, 0, 0}};
    for (int s = 0; s < bone_spring_count; ++s)
        for (int i = 0; i < 9; ++i)
            for (int lane = 0; lane < c.width; ++lane) {
                const double from_origin = i >= 2 && i < 5 ? c.state.origin[(i - 2) * c.width + lane] : 0;
                c.scratch.bone_springs[std::size_t((9 * s + i) * c.width + lane)] = T(springs[s][i] - from_origin);
            }
    std::fill(c.scratch.coupling_reach.begin(), c.scratch.coupling_reach.end(), T(1e30));
}

/// Touching area of these forces [mm^2]. A sample counts in full from a few mN on.
double touching_area(const ForceMatcher& m, const Eigen::Ref<const Eigen::VectorXd>& forces) {
    double area = 0;
    for (std::ptrdiff_t s = 0; s < m.area.size(); ++s) {
        const double f = forces.segment<3>(3 * s).norm();
        area += m.area[s] * f / (f + fitted::half_touching);
    }
    return area;
}

/// What is wrong with forces, weighted: of each sample, of their sum, of the touching area. Returns its norm.
double residual_of(const ForceMatcher& m, const MatchingSettings& settings,
                   const Eigen::Ref<const Eigen::VectorXd>& forces, Eigen::VectorXd& r) {
    const auto n = m.wanted.size();
    Eigen::Vector3d net = Eigen::Vector3d::Zero();
    for (std::ptrdiff_t i = 0; i < n; i += 3) net += m.wanted.segment<3>(i);
    const Eigen::Vector3d along = net.normalized();
    const double normal = std::sqrt(settings.normal_weight), tangential = std::sqrt(settings.tangential_weight);
    net.setZero();
    for (std::ptrdiff_t i = 0; i < n; i += 3) {
        const Eigen::Vector3d d = forces.segment<3>(i) - m.wanted.segment<3>(i);
        net += d;
        r.segment<3>(i) = tangential * d + (normal - tangential) * along.dot(d) * along;
    }
    r.segment<3>(n) = std::sqrt(settings.net_weight) * net;
    r[n + 3] = settings.area_weight > 0
                   ? std::sqrt(settings.area_weight) * (touching_area(m, forces) - touching_area(m, m.wanted))
                   : 0;
    if (settings.force_norm == ForceNorm::squares) return r.squaredNorm();
    double sum = std::abs(r[n + 3]);
    for (std::ptrdiff_t i = 0; i < n + 3; i += 3) sum += r.segment<3>(i).norm();
    return sum;
}

/// Where Gauss-Newton leads from the centre, for the forces wanted now. A sum of errors is the sum of squares of which
/// each is weighted by its inverse (iteratively reweighted least squares).
Coordinates gauss_newton(ForceMatcher& m, const DeviceModel& model, const MatchingSettings& settings, double damping) {
    const Coordinates& scale = model.kind->configuration_scale;
    residual_of(m, settings, m.centre_forces, m.residual);
    const auto n = m.centre.size();
    m.weighted = m.jacobian;
    if (settings.force_norm == ForceNorm::sum) {
        const double least = 0.01 * m.wanted.norm() + 1e-6;
        const auto groups = m.wanted.size() / 3 + 1;
        for (std::ptrdiff_t g = 0; g < groups; ++g)
            m.weight[g] = 1 / std::max(least, m.residual.segment<3>(3 * g).norm());
        m.weight[groups] = 1 / std::max(least, std::abs(m.residual[3 * groups]));
        const double mean = m.weight.mean();
        for (std::ptrdiff_t i = 0; i < m.residual.size(); ++i) { m.weighted.row(i) *= m.weight[i / 3] / mean; }
    }
    DeviceJacobian H(n, n);
    Coordinates g(n);
    H = m.weighted.transpose().lazyProduct(m.jacobian);
    g = m.weighted.transpose().lazyProduct(m.residual);
    // What no force tells stays as it is.
    const double level = std::max(1e-12, H.diagonal().maxCoeff());
    H.diagonal().array() += damping * level + 1e-6 * m.wanted.squaredNorm();
    // To the units of w.
    const Coordinates inverse = scale.cwiseInverse();
    H = inverse.asDiagonal() * H * inverse.asDiagonal();
    g = g.cwiseProduct(inverse);
    return move_inside_limits(model, m.centre, step_inside_limits(model, m.centre, H, g));
}

void take_jacobian(ForceMatcher& m, const DeviceModel& model, const MatchingSettings& settings) {
    const Coordinates& scale = model.kind->configuration_scale;
    const Coordinates& about = m.lane_w[0];
    residual_of(m, settings, m.forces.col(0), m.residual);
    for (std::ptrdiff_t k = 0; k < about.size(); ++k) {
        const double h = (m.lane_w[std::size_t(k) + 1][k] - about[k]) / scale[k];
        residual_of(m, settings, m.forces.col(k + 1), m.moved);
        m.jacobian.col(k) = (m.moved - m.residual) / h;
    }
    m.warm = true;
}

/// Lanes of the next round: `centre` and its neighbours; then what is to be tried, for as many as there are lanes.
void place_lanes(ForceMatcher& m, const DeviceModel& model, const Coordinates& centre,
                 std::array<Coordinates, 4> trials) {
    const auto n = centre.size();
    for (Coordinates& w : m.lane_w) w = centre;
    for (std::ptrdiff_t k = 0; k < n; ++k)
        m.lane_w[std::size_t(k) + 1][k] += difference * model.kind->configuration_scale[k];
    for (int lane = int(n) + 1, t = 0; lane < lane_count(m) && t < int(trials.size()); ++lane, ++t)
        m.lane_w[std::size_t(lane)] = trials[std::size_t(t)];
}

/// The shortest turn that takes z to a unit vector; where that is -z, about x. Eigen's FromTwoVectors has the same
/// bits, but for that one case it brings a singular value decomposition along, which takes ten seconds to compile.
Quaternion<double> turn_of_z_onto(const Eigen::Vector3d& n) {
    if (1 + n.z() < 1e-12) return {0, 1, 0, 0};
    const double s = std::sqrt(2 * (1 + n.z())), inverse = 1 / s;
    return {0.5 * s, -n.y() * inverse, n.x() * inverse, 0};
}

}  // namespace

Pose<double> platform_pose(const DeviceModel& model, const Coordinates& w) {
    const Platform p = model.kind->platform(model, w);
    const Eigen::Vector3d normal = model.mount.linear() * p.normal;
    const Eigen::Vector3d centre = model.mount * p.centre - 0.5 * platform_thickness * normal;
    return {{centre.x(), centre.y(), centre.z()}, turn_of_z_onto(normal.normalized())};
}

Shape platform_shape(const DeviceModel& model) {
    return {ShapeKind::cylinder, {model.disk_radius, 0.5 * platform_thickness, 0}};
}

ForceMatcher build_force_matcher(const SkinParameters& skin, Material material, const DeviceModel& model,
                                 const MatchingSettings& settings) {
    ForceMatcher m;
    m.solver.inertia = false;
    m.solver.newton_iterations = settings.force_iterations;
    m.solver.tolerance = 1e-4;
    m.solver.multiplier_tolerance = 1e-3;
    const auto topology = std::make_shared<const SkinTopology>(build_topology(*skin.mesh, true, 1));
    const int width = chunk_width<float>(lanes_wanted);
    while (lane_count(m) < lanes_wanted) {
        SkinChunk<float>& c = m.chunks.emplace_back();
        c.material = material;
        allocate_chunk(c, topology, width, skin.has_limits, false, 1, false, !skin.membrane_young.empty());
        for (int lane = 0; lane < width; ++lane) {
            set_lane(c, lane, lane_count(m), skin, Pose<double>::identity());
            m.lane_w.push_back(model.rest);
            LaneContact platform;
            platform.object = 0;
            platform.shape = platform_shape(model);
            insert_contact(c, lane, 0, platform);
        }
        hold_bone(c);
    }
    const auto n = std::ptrdiff_t(3 * topology->samples.size());
    m.forces.setZero(n, lane_count(m));
    m.wanted.setZero(n);
    const std::vector<double> areas = nodal_areas(*skin.mesh);
    m.area.resize(n / 3);
    for (std::ptrdiff_t i = 0; i < n / 3; ++i) m.area[i] = 1e6 * areas[std::size_t(topology->samples[std::size_t(i)])];
    m.residual.setZero(n + 4);
    m.moved.setZero(n + 4);
    m.weight.setZero(n / 3 + 2);
    m.jacobian.setZero(n + 4, model.rest.size());
    m.weighted = m.jacobian;
    m.centre_forces.setZero(n);
    m.centre = model.rest;
    return m;
}

void solve_pads(ForceMatcher& m, const DeviceModel& model) {
    int first = 0;
    for (SkinChunk<float>& c : m.chunks) {
        for (int lane = 0; lane < c.width; ++lane)
            c.contacts.at(0, lane).pose = c.contacts.at(0, lane).start =
                platform_pose(model, m.lane_w[std::size_t(first + lane)]);
        solve_skin(c, m.solver);
        const SkinTopology& t = *c.topology;
        for (int lane = 0; lane < c.width; ++lane) {
            ++m.solves;
            m.unconverged += !c.status[std::size_t(lane)].converged;
            const LaneContact& platform = c.contacts.at(0, lane);
            for (std::size_t s = 0; s < t.samples.size(); ++s) {
                const double force = c.state.normal_multiplier[s * std::size_t(c.width) + std::size_t(lane)];
                Vec3<double> f{0, 0, 0};
                if (force > 0)
                    f = force *
                        surface_point(platform.shape, platform.pose, node_position(c, t.samples[s], lane)).normal;
                for (int d = 0; d < 3; ++d) m.forces(std::ptrdiff_t(3 * s) + d, first + lane) = f[d];
            }
        }
        first += c.width;
    }
}

namespace {

/// Whether a lane's forces can be believed: near balance, limits and contact near kept. Those of a solve that was cut
/// short may be of any size, small ones included.
bool balanced(const ForceMatcher& m, int lane) {
    using namespace fitted;
    for (const SkinChunk<float>& c : m.chunks) {
        if (lane >= c.width) {
            lane -= c.width;
            continue;
        }
        const SkinStatus& status = c.status[std::size_t(lane)];
        return status.converged || (status.residual_N < believed_share * status.contact_force_N + believed_noise &&
                                    status.limit_violation < believed_excess && status.penetration_m < believed_depth);
    }
    return false;
}

}  // namespace

MatchingResult match_forces(ForceMatcher& m, const DeviceModel& model, const std::vector<MatchingPoint>& points,
                            const MatchingSettings& settings, const Coordinates& previous,
                            const MatchingResult& geometric) {
    if (geometric.status == MatchingStatus::no_contact || geometric.status == MatchingStatus::kept ||
        !m.wanted.allFinite()) {
        m.warm = false;
        return geometric;
    }
    MatchingResult best = geometric;
    double best_cost = HUGE_VAL, to_beat = HUGE_VAL;
    // Going on as last time, whose forces are known, unless another place is clearly better: what no force tells, such
    // as where along itself a platform lies, is not to follow the solves' rounding.
    // A sum of errors, which weighs small ones more, has its way in steps smaller than that.
    const bool stays = m.warm && settings.force_norm == ForceNorm::squares && inside_workspace(model, m.centre, 1e-7);
    if (stays) {
        best.w = m.centre;
        best_cost = residual_of(m, settings, m.centre_forces, m.residual);
        to_beat = (1 - fitted::clear_gain) * best_cost;
    }
    // Where the last step's linearisation sends the forces wanted now.
    Coordinates next = geometric.w;
    if (m.warm && inside_workspace(model, m.centre, 1e-7)) next = gauss_newton(m, model, settings, m.damping);
    for (int round = 0; round < settings.force_rounds; ++round) {
        const Coordinates before = round == 0 && !m.warm ? geometric.w : m.centre;
        place_lanes(m, model, next, {round == 0 ? geometric.w : best.w, before, 0.5 * (before + next), geometric.w});
        solve_pads(m, model);
        // Solved a little further, where there are lanes enough: going on may have been believed to be better than it
        // is.
        if (const int lane = int(before.size()) + 2; round == 0 && stays && lane < lane_count(m)) {
            const double cost = residual_of(m, settings, m.forces.col(lane), m.residual);
            const double shape = residual_of(m, settings, m.forces.col(lane - 1), m.residual);
            if (!balanced(m, lane)) {
                best.w = geometric.w;
                best_cost = to_beat = HUGE_VAL;
            } else if (shape < cost && balanced(m, lane - 1)) {
                m.centre_forces = m.forces.col(lane);
                best_cost = cost;
                to_beat = (1 - fitted::clear_gain) * cost;
            }
        }
        int best_lane = -1;
        for (int lane = 0; lane < lane_count(m); ++lane) {
            const Coordinates& w = m.lane_w[std::size_t(lane)];
            const double cost = residual_of(m, settings, m.forces.col(lane), m.residual);
            if (!(cost < to_beat) || !balanced(m, lane) || !inside_workspace(model, w, 1e-7)) continue;
            best_cost = to_beat = cost;
            best.w = w;
            best_lane = lane;
        }
        take_jacobian(m, model, settings);
        // The Jacobian is that of lane 0; forces are those of the best place known.
        if (best_lane >= 0) {
            m.centre = best.w;
            m.centre_forces = m.forces.col(best_lane);
        }
        const auto neighbours = int(best.w.size());
        m.damping = best_lane >= 0 && best_lane <= neighbours ? std::max(1e-4, 0.2 * m.damping)
                    : best_lane >= 0 || stays                 ? std::min(0.1, 2 * m.damping)
                                                              : std::min(1.0, 8 * m.damping);
        next = gauss_newton(m, model, settings, m.damping);
    }
    if (!std::isfinite(best_cost)) {
        m.warm = false;
        return geometric;
    }
    judge(model, points, settings, previous, best);
    best.force_residual_N = settings.force_norm == ForceNorm::sum ? best_cost : std::sqrt(best_cost);
    best.status = MatchingStatus::matched;
    return best;
}

}  // namespace palpate
