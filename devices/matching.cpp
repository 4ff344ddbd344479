#include "devices/matching.h"

#include <nlopt.h>

#include <cmath>
#include <memory>

#include "devices/least_squares.h"

namespace palpate {

namespace {

constexpr double mm2 = 1e6;  // objective in mm^2

double smoothing_value(const DeviceModel& model, const MatchingSettings& settings, const Coordinates& previous,
                       const Coordinates& w, Coordinates& gradient) {
    // A little of it always: where a single point touches, the tilt is otherwise free.
    const double weight = settings.smoothing + 1e-6;
    const Coordinates d = (w - previous).cwiseQuotient(model.kind->configuration_scale);
    gradient += 2 * weight * d.cwiseQuotient(model.kind->configuration_scale);
    return weight * d.squaredNorm();
}

}  // namespace

MatchingObjective matching_objective(const DeviceModel& model, const std::vector<MatchingPoint>& points,
                                     const MatchingSettings& settings, const Coordinates& previous,
                                     const Coordinates& w) {
    const Platform platform = model.kind->platform(model, w);
    MatchingObjective f{0, Coordinates::Zero(w.size())};
    for (const MatchingPoint& point : points) {
        if (!point.touches && !settings.non_contact) continue;
        const DiskDistance d = point.touches ? disk_distance(point.position, platform, model.disk_radius)
                                             : cone_distance(point.position, platform, model.disk_radius);
        const double excess = point.touches ? d.value : d.value - model.clearance;
        if (!point.touches && excess >= 0) continue;
        f.value += mm2 * excess * excess;
        f.gradient +=
            2 * mm2 * excess * (platform.dcentre.transpose() * d.dcentre + platform.dnormal.transpose() * d.dnormal);
    }
    f.value += smoothing_value(model, settings, previous, w, f.gradient);
    return f;
}

namespace {

/// One SLSQP problem in scaled variables u = w / scale, guarded against the solver's known failures:
/// it may return infeasible or non-finite points, so the best feasible one is kept here.
struct Problem {
    const DeviceModel* model;
    const std::vector<MatchingPoint>* points = nullptr;  ///< null: project onto the workspace
    const MatchingSettings* settings = nullptr;
    Coordinates previous;  ///< warm start, or the configuration to project
    bool constrained = true;
    nlopt_opt optimiser = nullptr;
    Coordinates best;  ///< best feasible w so far
    double best_value = HUGE_VAL;
    int evaluations = 0;

    Coordinates unscaled(const double* u) const {
        return Eigen::Map<const Coordinates>(u, previous.size()).cwiseProduct(model->kind->configuration_scale);
    }
    MatchingObjective objective(const Coordinates& w) const {
        if (points) return matching_objective(*model, *points, *settings, previous, w);
        const Coordinates d = (w - previous).cwiseQuotient(model->kind->configuration_scale);
        return {d.squaredNorm(), 2 * d.cwiseQuotient(model->kind->configuration_scale)};
    }
    void offer(const Coordinates& w, double value) {
        if (std::isfinite(value) && value < best_value && (!constrained || inside_workspace(*model, w, 1e-7)))
            best = w, best_value = value;
    }
};

double objective_callback(unsigned n, const double* u, double* gradient, void* data) {
    Problem& p = *static_cast<Problem*>(data);
    const Coordinates w = p.unscaled(u);
    const MatchingObjective f = p.objective(w);
    ++p.evaluations;
    if (!std::isfinite(f.value) || !f.gradient.allFinite()) {
        nlopt_force_stop(p.optimiser);
        if (gradient) std::fill(gradient, gradient + n, 0.0);
        return HUGE_VAL;
    }
    p.offer(w, f.value);
    if (gradient) Eigen::Map<Coordinates>(gradient, n) = f.gradient.cwiseProduct(p.model->kind->configuration_scale);
    return f.value;
}

/// NLopt wants constraints <= 0: minus C(q(w)).
void constraint_callback(unsigned m, double* result, unsigned n, const double* u, double* gradient, void* data) {
    Problem& p = *static_cast<Problem*>(data);
    const Joints joints = p.model->kind->joints(*p.model, p.unscaled(u));
    const auto margins = joint_margins(*p.model, joints.q);
    for (unsigned i = 0; i < m; ++i) result[i] = -margins[i];
    if (!gradient) return;
    const unsigned half = m / 2;
    for (unsigned i = 0; i < m; ++i)
        for (unsigned k = 0; k < n; ++k)
            gradient[i * n + k] = (i < half ? -1 : 1) * joints.dq(i % half, k) * p.model->kind->configuration_scale[k];
}

nlopt_result run(Problem& p, const Coordinates& start, double tolerance, int evaluations) {
    const DeviceKind& kind = *p.model->kind;
    const unsigned n = unsigned(start.size());
    const std::unique_ptr<std::remove_pointer_t<nlopt_opt>, void (*)(nlopt_opt)> owner(nlopt_create(NLOPT_LD_SLSQP, n),
                                                                                       nlopt_destroy);
    p.optimiser = owner.get();
    if (!p.optimiser) return NLOPT_OUT_OF_MEMORY;
    // An open chain's joint limits are bounds of the search itself.
    const bool bounds = kind.open_chain && p.constrained;
    const Coordinates low =
        (bounds ? p.model->joint_min : kind.configuration_min).cwiseQuotient(kind.configuration_scale);
    const Coordinates high =
        (bounds ? p.model->joint_max : kind.configuration_max).cwiseQuotient(kind.configuration_scale);
    Coordinates u = start.cwiseQuotient(kind.configuration_scale).cwiseMax(low).cwiseMin(high);
    nlopt_set_lower_bounds(p.optimiser, low.data());
    nlopt_set_upper_bounds(p.optimiser, high.data());
    nlopt_set_min_objective(p.optimiser, objective_callback, &p);
    if (p.constrained && !kind.open_chain) {
        const Eigen::Matrix<double, 2 * max_device_dimension, 1> tolerances =
            Eigen::Matrix<double, 2 * max_device_dimension, 1>::Constant(1e-9);
        nlopt_add_inequality_mconstraint(p.optimiser, 2 * unsigned(kind.joint_count), constraint_callback, &p,
                                         tolerances.data());
    }
    nlopt_set_xtol_abs1(p.optimiser, tolerance);
    nlopt_set_ftol_rel(p.optimiser, tolerance * tolerance);
    nlopt_set_maxeval(p.optimiser, evaluations);
    double value = 0;
    return nlopt_optimize(p.optimiser, u.data(), &value);
}

MatchingResult finish(const DeviceModel& model, const std::vector<MatchingPoint>& points,
                      const MatchingSettings& settings, const Coordinates& previous, const Coordinates& w,
                      MatchingStatus status, int evaluations) {
    MatchingResult r;
    r.w = w;
    r.status = status;
    r.evaluations = evaluations;
    r.q = model.kind->joints(model, w).q.cwiseMax(model.joint_min).cwiseMin(model.joint_max);
    r.residual = matching_objective(model, points, settings, previous, w).value;
    r.constraint_active = joint_margins(model, r.q).minCoeff() < 1e-5;
    const Platform platform = model.kind->platform(model, w);
    double sum = 0;
    int count = 0;
    for (const MatchingPoint& p : points)
        if (p.touches) {
            const double d = disk_distance(p.position, platform, model.disk_radius).value;
            sum += d * d, ++count;
        }
    r.rms_m = count ? std::sqrt(sum / count) : 0;
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

/// Objective with what Gauss-Newton needs: distances are residuals, and the rows of J their gradients.
struct Residuals {
    double value = 0;        ///< as matching_objective [mm^2]
    Coordinates gradient;    ///< half of it
    DeviceJacobian hessian;  ///< J' J
};
Residuals residuals_at(const DeviceModel& model, const std::vector<MatchingPoint>& points,
                       const MatchingSettings& settings, const Coordinates& previous, const Coordinates& w) {
    const auto n = w.size();
    const Platform platform = model.kind->platform(model, w);
    Residuals r{0, Coordinates::Zero(n), DeviceJacobian::Zero(n, n)};
    for (const MatchingPoint& point : points) {
        if (!point.touches && !settings.non_contact) continue;
        const DiskDistance d = point.touches ? disk_distance(point.position, platform, model.disk_radius)
                                             : cone_distance(point.position, platform, model.disk_radius);
        const double excess = point.touches ? d.value : d.value - model.clearance;
        if (!point.touches && excess >= 0) continue;
        const Coordinates row = platform.dcentre.transpose() * d.dcentre + platform.dnormal.transpose() * d.dnormal;
        r.value += mm2 * excess * excess;
        r.gradient += mm2 * excess * row;
        r.hessian.selfadjointView<Eigen::Lower>().rankUpdate(row, mm2);
    }
    r.hessian = DeviceJacobian(r.hessian.selfadjointView<Eigen::Lower>());
    Coordinates twice = Coordinates::Zero(n);
    r.value += smoothing_value(model, settings, previous, w, twice);
    r.gradient += 0.5 * twice;
    const double weight = settings.smoothing + 1e-6;
    r.hessian.diagonal() += weight * model.kind->configuration_scale.cwiseAbs2().cwiseInverse();
    return r;
}

/// Levenberg-Marquardt from `start`, which is inside. Returns the best configuration and its value.
std::pair<Coordinates, double> descend(const DeviceModel& model, const std::vector<MatchingPoint>& points,
                                       const MatchingSettings& settings, const Coordinates& previous,
                                       const Coordinates& start, int& evaluations, bool& budget) {
    Coordinates w = start;
    Residuals at = residuals_at(model, points, settings, previous, w);
    ++evaluations;
    double damping = 1e-6;
    budget = true;
    const Coordinates scale2 = model.kind->configuration_scale.cwiseAbs2().cwiseInverse();
    for (; evaluations < settings.evaluations;) {
        DeviceJacobian H = at.hessian;
        H.diagonal() += damping * (H.diagonal() + scale2);
        const Coordinates d = shorten_to_workspace(model, w, step_inside_limits(model, w, H, at.gradient));
        const double length = d.cwiseQuotient(model.kind->configuration_scale).norm();
        if (length < settings.tolerance) return budget = false, std::pair{w, at.value};
        const Residuals next = residuals_at(model, points, settings, previous, w + d);
        ++evaluations;
        if (next.value < at.value) {
            const double gained = at.value - next.value;
            w += d;
            at = next;
            damping = std::max(1e-9, 0.1 * damping);
            if (gained < settings.tolerance * settings.tolerance * (1 + at.value))
                return budget = false, std::pair{w, at.value};
        } else {
            damping = std::max(1e-4, 10 * damping);
            if (!std::isfinite(damping) || damping > 1e8) return budget = false, std::pair{w, at.value};
        }
    }
    return {w, at.value};
}

MatchingResult match_least_squares(const DeviceModel& model, const std::vector<MatchingPoint>& points,
                                   const MatchingSettings& settings, const Coordinates& start) {
    int evaluations = 0;
    bool budget = false;
    auto [best, value] = descend(model, points, settings, start, start, evaluations, budget);
    if (settings.solver == MatchingSolver::multistart) {
        // Places that fill the box evenly (Halton), brought into the workspace.
        static constexpr int primes[max_device_dimension] = {2, 3, 5, 7, 11, 13};
        const Coordinates low = model.kind->open_chain ? model.joint_min : model.kind->configuration_min;
        const Coordinates high = model.kind->open_chain ? model.joint_max : model.kind->configuration_max;
        for (int k = 1; k <= 64; ++k) {
            Coordinates w(start.size());
            for (std::ptrdiff_t i = 0; i < w.size(); ++i) {
                double f = 1, u = 0;
                for (int x = k; x > 0; x /= primes[i]) u += (f /= primes[i]) * (x % primes[i]);
                w[i] = low[i] + u * (high[i] - low[i]);
            }
            int used = 0;
            bool unused = false;
            const auto [other, other_value] =
                descend(model, points, settings, start, project_to_workspace(model, w), used, unused);
            evaluations += used;
            if (other_value < value) best = other, value = other_value;
        }
    }
    return finish(model, points, settings, start, best, budget ? MatchingStatus::budget : MatchingStatus::matched,
                  evaluations);
}

}  // namespace

Coordinates project_to_workspace(const DeviceModel& model, const Coordinates& w) {
    if (!w.allFinite()) return model.rest;
    if (inside_workspace(model, w)) return w;
    if (model.kind->open_chain) return w.cwiseMax(model.joint_min).cwiseMin(model.joint_max);
    Problem p;
    p.model = &model;
    p.previous = w;
    p.best = model.rest;
    run(p, model.rest, 1e-8, 200);
    return p.best;
}

MatchingResult match_constrained(const DeviceModel& model, const std::vector<MatchingPoint>& points,
                                 const MatchingSettings& settings, const Coordinates& previous) {
    MatchingResult result;
    const Coordinates start = usable_start(model, previous);
    if (!has_contact(model, points, settings, start, result)) return result;
    if (settings.solver != MatchingSolver::slsqp) return match_least_squares(model, points, settings, start);
    Problem p;
    p.model = &model;
    p.points = &points;
    p.settings = &settings;
    p.previous = p.best = start;
    // A start outside the search's box is moved into it: the result must not be worse than it was, all the same.
    if (start != start.cwiseMax(model.kind->configuration_min).cwiseMin(model.kind->configuration_max))
        p.offer(start, p.objective(start).value);
    const nlopt_result code = run(p, start, settings.tolerance, settings.evaluations);
    const MatchingStatus status = code == NLOPT_MAXEVAL_REACHED ? MatchingStatus::budget
                                  : p.best == start && code < 0 ? MatchingStatus::kept
                                                                : MatchingStatus::matched;
    return finish(model, points, settings, start, p.best, status, p.evaluations);
}

MatchingResult match_unconstrained(const DeviceModel& model, const std::vector<MatchingPoint>& points,
                                   const MatchingSettings& settings, const Coordinates& previous) {
    MatchingResult result;
    const Coordinates start = usable_start(model, previous);
    if (!has_contact(model, points, settings, start, result)) return result;
    Problem p;
    p.model = &model;
    p.points = &points;
    p.settings = &settings;
    p.previous = p.best = start;
    p.constrained = false;
    const nlopt_result code = run(p, start, settings.tolerance, settings.evaluations);
    const MatchingStatus status = code == NLOPT_MAXEVAL_REACHED ? MatchingStatus::budget : MatchingStatus::matched;
    return finish(model, points, settings, start, project_to_workspace(model, p.best), status, p.evaluations);
}

MatchingResult match_plane(const DeviceModel& model, const std::vector<MatchingPoint>& points,
                           const MatchingSettings& settings, const Coordinates& previous) {
    MatchingResult result;
    const Coordinates start = usable_start(model, previous);
    if (!has_contact(model, points, settings, start, result)) return result;
    Eigen::Vector3d centre = Eigen::Vector3d::Zero();
    int count = 0;
    for (const MatchingPoint& p : points)
        if (p.touches) centre += p.position, ++count;
    centre /= count;
    Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
    for (const MatchingPoint& p : points)
        if (p.touches) covariance += (p.position - centre) * (p.position - centre).transpose();
    // Where points leave a direction free, the platform stays level.
    const double level = 1e-6 * covariance.trace() + 1e-12;
    covariance.diagonal() += Eigen::Vector3d(level, level, 0);
    Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver;
    solver.computeDirect(covariance);
    Eigen::Vector3d normal = solver.eigenvectors().col(0);
    if (normal.z() > 0) normal = -normal;  // towards the finger

    // Configuration with that normal, its plane through the centre of the points: Gauss-Newton.
    Coordinates w = model.rest;
    for (int i = 0; i < 20; ++i) {
        const Platform platform = model.kind->platform(model, w);
        constexpr double lever = 100;  // 10 mm off the plane weigh as much as one radian
        Eigen::Matrix<double, 4, Eigen::Dynamic, 0, 4, max_device_dimension> J(4, w.size());
        J.topRows<3>() = platform.dnormal;
        J.row(3) = lever * normal.transpose() * platform.dcentre;
        Eigen::Vector4d r;
        r << platform.normal - normal, lever * normal.dot(platform.centre - centre);
        DeviceJacobian H = J.transpose() * J;
        H.diagonal().array() += 1e-12;
        w -= Coordinates(H.ldlt().solve(J.transpose() * r));
        w = w.cwiseMax(model.kind->configuration_min).cwiseMin(model.kind->configuration_max);
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
