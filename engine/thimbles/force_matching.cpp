#include "engine/thimbles/force_matching.h"

#include <algorithm>
#include <cmath>

#include "devices/least_squares.h"
#include "engine/skin/solve_skin.h"

namespace palpate {

namespace {

constexpr int lanes_wanted = 8;      ///< one for the centre, up to six for the Jacobian, the rest for trials
constexpr double difference = 0.02;  ///< of a component's scale: 0.3 degrees, 0.08 mm

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
}

/// Solves the pad in every lane's configuration.
void solve_lanes(ForceMatcher& m, const DeviceModel& model) {
    int first = 0;
    for (SkinChunk<float>& c : m.chunks) {
        for (int lane = 0; lane < c.width; ++lane)
            c.lane_poses[std::size_t(lane)] = platform_pose(model, m.lane_w[std::size_t(first + lane)]);
        solve_skin(c, m.solver);
        const SkinTopology& t = *c.topology;
        for (int lane = 0; lane < c.width; ++lane) {
            ++m.solves;
            m.unconverged += !c.status[std::size_t(lane)].converged;
            const Pose<double>& pose = c.lane_poses[std::size_t(lane)];
            for (std::size_t s = 0; s < t.samples.size(); ++s) {
                const double force = c.state.normal_multiplier[s * std::size_t(c.width) + std::size_t(lane)];
                Vec3<double> f{0, 0, 0};
                if (force > 0)
                    f = force * surface_point(c.slots[0].shape, pose, node_position(c, t.samples[s], lane)).normal;
                for (int d = 0; d < 3; ++d) m.forces(std::ptrdiff_t(3 * s) + d, first + lane) = f[d];
            }
        }
        first += c.width;
    }
}

/// What is wrong with forces: F - Fbar, and with a weight the same of their sum.
double residual_of(const Eigen::VectorXd& wanted, double net_weight, const Eigen::Ref<const Eigen::VectorXd>& forces,
                   Eigen::VectorXd& r) {
    const auto n = wanted.size();
    r.head(n) = forces - wanted;
    r.tail<3>().setZero();
    if (net_weight > 0) {
        for (std::ptrdiff_t i = 0; i < n; i += 3) r.tail<3>() += r.segment<3>(i);
        r.tail<3>() *= std::sqrt(net_weight);
    }
    return r.squaredNorm();
}

/// Where Gauss-Newton leads from the centre, for the forces wanted now.
Coordinates gauss_newton(ForceMatcher& m, const DeviceModel& model, const MatchingSettings& settings, double damping) {
    const Coordinates& scale = model.kind->configuration_scale;
    residual_of(m.wanted, settings.net_weight, m.centre_forces, m.residual);
    const auto n = m.centre.size();
    DeviceJacobian H(n, n);
    Coordinates g(n);
    H.noalias() = m.jacobian.transpose() * m.jacobian;
    g.noalias() = m.jacobian.transpose() * m.residual;
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
    const auto n = m.lane_w[0].size();
    const Coordinates& about = m.lane_w[0];
    for (std::ptrdiff_t k = 0; k < n; ++k) {
        const double h = (m.lane_w[std::size_t(k) + 1][k] - about[k]) / scale[k];
        auto column = m.jacobian.col(k);
        column.head(m.wanted.size()) = (m.forces.col(k + 1) - m.forces.col(0)) / h;
        column.tail<3>().setZero();
        if (settings.net_weight <= 0) continue;
        for (std::ptrdiff_t i = 0; i < m.wanted.size(); i += 3) column.tail<3>() += column.segment<3>(i);
        column.tail<3>() *= std::sqrt(settings.net_weight);
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

}  // namespace

Pose<double> platform_pose(const DeviceModel& model, const Coordinates& w) {
    const Platform p = model.kind->platform(model, w);
    const Eigen::Vector3d normal = model.mount.linear() * p.normal;
    const Eigen::Vector3d centre = model.mount * p.centre - 0.5 * platform_thickness * normal;
    const Eigen::Quaterniond q = Eigen::Quaterniond::FromTwoVectors(Eigen::Vector3d::UnitZ(), normal);
    return {{centre.x(), centre.y(), centre.z()}, {q.w(), q.x(), q.y(), q.z()}};
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
        allocate_chunk(c, topology, width, skin.has_limits, false, 1);
        c.material = material;
        for (int lane = 0; lane < width; ++lane) {
            set_lane(c, lane, lane_count(m), skin, Pose<double>::identity());
            m.lane_w.push_back(model.rest);
        }
        c.slots[0].object = 0;
        c.slots[0].shape = platform_shape(model);
        c.lane_poses.assign(std::size_t(width), platform_pose(model, model.rest));
        hold_bone(c);
    }
    const auto n = std::ptrdiff_t(3 * topology->samples.size());
    m.forces.setZero(n, lane_count(m));
    m.wanted.setZero(n);
    m.residual.setZero(n + 3);
    m.jacobian.setZero(n + 3, model.rest.size());
    m.centre_forces.setZero(n);
    m.centre = model.rest;
    return m;
}

MatchingResult match_forces(ForceMatcher& m, const DeviceModel& model, const MatchingSettings& settings,
                            const MatchingResult& geometric) {
    if (geometric.status == MatchingStatus::no_contact || geometric.status == MatchingStatus::kept ||
        !m.wanted.allFinite()) {
        m.warm = false;
        return geometric;
    }
    MatchingResult best = geometric;
    double best_cost = HUGE_VAL;
    // Where the last step's linearisation sends the forces wanted now.
    Coordinates next = geometric.w;
    if (m.warm && inside_workspace(model, m.centre, 1e-7)) next = gauss_newton(m, model, settings, m.damping);
    for (int round = 0; round < settings.force_rounds; ++round) {
        const Coordinates before = round == 0 && !m.warm ? geometric.w : m.centre;
        place_lanes(m, model, next, {round == 0 ? geometric.w : best.w, 0.5 * (before + next), before, geometric.w});
        solve_lanes(m, model);
        int best_lane = -1;
        for (int lane = 0; lane < lane_count(m); ++lane) {
            const Coordinates& w = m.lane_w[std::size_t(lane)];
            const double cost = residual_of(m.wanted, settings.net_weight, m.forces.col(lane), m.residual);
            if (!(cost < best_cost) || !inside_workspace(model, w, 1e-7)) continue;
            best_cost = cost;
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
                    : best_lane >= 0                          ? std::min(0.1, 2 * m.damping)
                                                              : std::min(1.0, 8 * m.damping);
        next = gauss_newton(m, model, settings, m.damping);
    }
    if (!std::isfinite(best_cost)) {
        m.warm = false;
        return geometric;
    }
    best.q = model.kind->joints(model, best.w).q.cwiseMax(model.joint_min).cwiseMin(model.joint_max);
    best.constraint_active = joint_margins(model, best.q).minCoeff() < 1e-5;
    best.force_residual_N = std::sqrt(best_cost);
    best.status = MatchingStatus::matched;
    return best;
}

}  // namespace palpate
