#include "devices/matching/matching.h"

#include <Eigen/Eigenvalues>
#include <cmath>

#include "devices/matching/descent.h"
#include "devices/matching/fitted.h"
#include "devices/matching/least_squares.h"
#include "devices/matching/slsqp.h"
#include "devices/matching/small_systems.h"

namespace palpate {

void judge(const DeviceModel& model, const std::vector<MatchingPoint>& points, const MatchingSettings& settings,
           const Coordinates& previous, MatchingResult& r) {
    r.q = model.kind->joints(model, r.w).q.cwiseMax(model.joint_min).cwiseMin(model.joint_max);
    r.residual = matching_objective(model, points, settings, previous, r.w).value;
    r.constraint_active = at_a_limit(model, r.q);
    const Platform platform = model.kind->platform(model, r.w);
    double sum = 0, weights = 0;
    for (const MatchingPoint& p : points)
        if (p.touches) {
            const double d = disk_distance(p.position, platform, model.disk_radius).value;
            sum += p.weight * d * d, weights += p.weight;
        }
    r.rms_m = weights > 0 ? std::sqrt(sum / weights) : 0;
}

namespace {

MatchingResult finish(const DeviceModel& model, const std::vector<MatchingPoint>& points,
                      const MatchingSettings& settings, const Coordinates& previous, const Coordinates& w,
                      MatchingStatus status, int evaluations) {
    MatchingResult r;
    r.w = w;
    r.status = status;
    r.evaluations = evaluations;
    judge(model, points, settings, previous, r);
    return r;
}

/// True where there is something to match; otherwise `result` is the rest configuration or, for
/// positions that are not finite, the last one.
bool has_contact(const DeviceModel& model, const std::vector<MatchingPoint>& points, const MatchingSettings& settings,
                 const Coordinates& previous, MatchingResult& result) {
    bool touches = false, sound = true;
    for (const MatchingPoint& p : points) touches |= p.touches, sound &= p.position.allFinite();
    if (!sound) {
        result = finish(model, {}, settings, previous, previous, MatchingStatus::kept, 0);
        return false;
    }
    if (!touches) result = finish(model, {}, settings, model.rest, model.rest, MatchingStatus::no_contact, 0);
    return touches;
}

Coordinates usable_start(const DeviceModel& model, const Coordinates& previous) {
    return previous.size() == model.rest.size() && inside_workspace(model, previous, 1e-7) ? previous : model.rest;
}

SlsqpProblem matching_problem(const DeviceModel& model, const NearSamples& samples, const MatchingSettings& settings,
                              const Coordinates& start) {
    SlsqpProblem p;
    p.model = &model;
    p.samples = &samples;
    p.settings = &settings;
    p.previous = start;
    return p;
}

/// Below which objective another place is gone to from one of `value` [mm^2]; "multistart" takes the best there is.
double worth_leaving(const std::vector<MatchingPoint>& points, const MatchingSettings& settings, double value) {
    if (settings.solver == MatchingSolver::multistart) return value;
    double weights = 0;
    for (const MatchingPoint& p : points)
        if (p.touches) weights += p.weight;
    return (1 - fitted::clear_gain) * value - weights * fitted::clear_distance * fitted::clear_distance;
}

}  // namespace

MatchingResult match_constrained(const DeviceModel& model, const std::vector<MatchingPoint>& points,
                                 const MatchingSettings& settings, const Coordinates& previous) {
    MatchingResult result;
    const Coordinates start = usable_start(model, previous);
    if (!has_contact(model, points, settings, start, result)) return result;
    const NearSamples samples = near_samples(model, points, settings, start);
    const bool slsqp = settings.solver == MatchingSolver::slsqp;
    Descent best = slsqp ? minimise(matching_problem(model, samples, settings, start), start)
                         : descend(model, samples, settings, start, start);
    const bool failed = best.end == DescentEnd::failed && best.w == start;
    const Descent elsewhere = settings.solver == MatchingSolver::multistart
                                  ? descend_from_everywhere(model, points, settings, start)
                                  : descend_from_the_sides(model, points, settings, start, best);
    const int evaluations = best.evaluations + elsewhere.evaluations;
    if (elsewhere.value < worth_leaving(points, settings, best.value)) best = elsewhere;
    const MatchingStatus status = best.end == DescentEnd::budget ? MatchingStatus::budget
                                  : failed && best.w == start    ? MatchingStatus::kept
                                                                 : MatchingStatus::matched;
    return finish(model, points, settings, start, best.w, status, evaluations);
}

MatchingResult match_unconstrained(const DeviceModel& model, const std::vector<MatchingPoint>& points,
                                   const MatchingSettings& settings, const Coordinates& previous) {
    MatchingResult result;
    const Coordinates start = usable_start(model, previous);
    if (!has_contact(model, points, settings, start, result)) return result;
    const NearSamples samples = near_samples(model, points, settings, start);
    SlsqpProblem p = matching_problem(model, samples, settings, start);
    p.constrained = false;
    const Descent d = minimise(p, start);
    const MatchingStatus status = d.end == DescentEnd::budget ? MatchingStatus::budget : MatchingStatus::matched;
    return finish(model, points, settings, start, project_to_workspace(model, d.w), status, d.evaluations);
}

MatchingResult match_plane(const DeviceModel& model, const std::vector<MatchingPoint>& points,
                           const MatchingSettings& settings, const Coordinates& previous) {
    MatchingResult result;
    const Coordinates start = usable_start(model, previous);
    if (!has_contact(model, points, settings, start, result)) return result;
    Eigen::Vector3d centre = Eigen::Vector3d::Zero();
    double weights = 0;
    for (const MatchingPoint& p : points)
        if (p.touches) centre += p.weight * p.position, weights += p.weight;
    centre /= weights;
    Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
    for (const MatchingPoint& p : points)
        if (p.touches) covariance += p.weight * (p.position - centre) * (p.position - centre).transpose();
    // Where points leave a direction free, the platform stays level.
    const double level = 1e-6 * covariance.trace() + 1e-12;
    covariance.diagonal() += Eigen::Vector3d(level, level, 0);
    Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver;
    solver.computeDirect(covariance);
    Eigen::Vector3d normal = solver.eigenvectors().col(0);
    if (normal.z() > 0) normal = -normal;  // towards the finger

    // Configuration with that normal, its plane through the centre of the points: Gauss-Newton.
    const ConfigurationBox box = search_box(model);
    Coordinates w = model.rest;
    for (int i = 0; i < 20; ++i) {
        const Platform platform = model.kind->platform(model, w);
        constexpr double lever = fitted::plane_lever;
        Eigen::Matrix<double, 4, Eigen::Dynamic, 0, 4, max_device_dimension> J(4, w.size());
        J.topRows<3>() = platform.dnormal;
        J.row(3) = lever * normal.transpose().lazyProduct(platform.dcentre);
        Eigen::Vector4d r;
        r << platform.normal - normal, lever * normal.dot(platform.centre - centre);
        DeviceJacobian H = J.transpose().lazyProduct(J);
        H.diagonal().array() += 1e-12 * std::max(1.0, H.trace());
        Coordinates step = J.transpose().lazyProduct(r);
        const SmallCholesky factor(H);
        if (factor.n == 0) break;
        factor.solve(step.data());
        w -= step;
        w = w.cwiseMax(box.low).cwiseMin(box.high);
    }
    return finish(model, points, settings, start, project_to_workspace(model, w), MatchingStatus::matched, 1);
}

MatchingResult match(MatchingMethod method, const DeviceModel& model, const std::vector<MatchingPoint>& points,
                     const MatchingSettings& settings, const Coordinates& previous) {
    switch (method) {
        case MatchingMethod::constrained:
        case MatchingMethod::force:
            return match_constrained(model, points, settings, previous);
        case MatchingMethod::unconstrained:
            return match_unconstrained(model, points, settings, previous);
        case MatchingMethod::plane:
            return match_plane(model, points, settings, previous);
    }
    return {};
}

DeviceModel within_a_step(const DeviceModel& model, const Coordinates& from, double joint_step) {
    DeviceModel near = model;
    const Coordinates q = model.kind->joints(model, from).q;
    near.joint_min = (q.array() - joint_step).max(model.joint_min.array()).min(model.joint_max.array());
    near.joint_max = (q.array() + joint_step).min(model.joint_max.array()).max(model.joint_min.array());
    near.rest = move_inside_limits(near, from, model.rest - from);
    return near;
}

bool parse_method(const std::string& name, MatchingMethod& method) {
    if (name == "constrained")
        method = MatchingMethod::constrained;
    else if (name == "unconstrained")
        method = MatchingMethod::unconstrained;
    else if (name == "plane")
        method = MatchingMethod::plane;
    else if (name == "force")
        method = MatchingMethod::force;
    else
        return false;
    return true;
}

}  // namespace palpate
