#include "devices/matching/slsqp.h"

#include <nlopt.h>

#include <memory>

#include "devices/matching/small_systems.h"

namespace palpate {

namespace {

/// A search as it runs, in coordinates v: w = origin + basis v.
struct Search {
    const SlsqpProblem& problem;
    Coordinates origin;
    DeviceJacobian basis;
    Descent best;
    Joints joints;  ///< of `joints_of`: what the constraints and the check for feasibility share
    Coordinates joints_of;
    nlopt_opt optimiser = nullptr;
};

Coordinates configuration(const Search& s, const double* v) {
    return s.origin + s.basis.lazyProduct(Eigen::Map<const Coordinates>(v, s.origin.size()));
}

const Joints& joints_at(Search& s, const Coordinates& w) {
    if (s.joints_of.size() == w.size() && s.joints_of == w) return s.joints;
    s.joints = s.problem.model->kind->joints(*s.problem.model, w);
    s.joints_of = w;
    return s.joints;
}

bool feasible(Search& s, const Coordinates& w) {
    const Joints& joints = joints_at(s, w);
    return joints.closed && joints.q.allFinite() && joint_margins(*s.problem.model, joints.q).minCoeff() >= -1e-7;
}

MatchingObjective objective(const SlsqpProblem& p, const Coordinates& w) {
    if (p.samples) return matching_objective(*p.model, *p.samples, *p.settings, p.previous, w);
    const Coordinates& scale = p.model->kind->configuration_scale;
    const Coordinates d = (w - p.previous).cwiseQuotient(scale);
    return {d.squaredNorm(), 2 * d.cwiseQuotient(scale)};
}

void offer(Search& s, const Coordinates& w, double value) {
    if (value < s.best.value && (!s.problem.constrained || feasible(s, w))) s.best.w = w, s.best.value = value;
}

double objective_callback(unsigned n, const double* v, double* gradient, void* data) {
    Search& s = *static_cast<Search*>(data);
    const Coordinates w = configuration(s, v);
    const MatchingObjective f = objective(s.problem, w);
    ++s.best.evaluations;
    if (!std::isfinite(f.value) || !f.gradient.allFinite()) {
        nlopt_force_stop(s.optimiser);
        if (gradient) std::fill(gradient, gradient + n, 0.0);
        return HUGE_VAL;
    }
    offer(s, w, f.value);
    if (gradient) Eigen::Map<Coordinates>(gradient, n) = s.basis.transpose().lazyProduct(f.gradient);
    return f.value;
}

/// NLopt wants constraints <= 0: minus C(q(w)).
void constraint_callback(unsigned m, double* result, unsigned n, const double* v, double* gradient, void* data) {
    Search& s = *static_cast<Search*>(data);
    const Joints& joints = joints_at(s, configuration(s, v));
    const auto margins = joint_margins(*s.problem.model, joints.q);
    for (unsigned i = 0; i < m; ++i) result[i] = -margins[i];
    if (!gradient) return;
    const DeviceJacobian dq = joints.dq.lazyProduct(s.basis);
    const unsigned half = m / 2;
    for (unsigned i = 0; i < m; ++i)
        for (unsigned k = 0; k < n; ++k) gradient[i * n + k] = (i < half ? -1 : 1) * dq(i % half, k);
}

/// S L^-T with S the typical sizes and L L' the Hessian in units of them; what the samples leave free keeps its size.
DeviceJacobian natural_basis(const SlsqpProblem& p, const Coordinates& start) {
    const auto S = p.model->kind->configuration_scale.asDiagonal();
    DeviceJacobian H = matching_residuals(*p.model, *p.samples, *p.settings, p.previous, start).hessian;
    H = 2 * (S * H * S);
    H.diagonal().array() += 1e-6 + 1e-3 * H.diagonal().maxCoeff();
    const SmallCholesky factor(H);
    DeviceJacobian basis = DeviceJacobian::Identity(H.rows(), H.cols());
    if (H.allFinite() && factor.n != 0)
        for (std::ptrdiff_t k = 0; k < basis.cols(); ++k) factor.solve_transposed(basis.col(k).data());
    return S * basis;
}

}  // namespace

Descent minimise(const SlsqpProblem& p, const Coordinates& start) {
    const DeviceKind& kind = *p.model->kind;
    const unsigned n = unsigned(start.size());
    const std::unique_ptr<std::remove_pointer_t<nlopt_opt>, void (*)(nlopt_opt)> optimiser(
        nlopt_create(NLOPT_LD_SLSQP, n), nlopt_destroy);
    Search s{p, {}, {}, {}, {}, {}, optimiser.get()};
    s.best.w = start;
    s.best.end = DescentEnd::failed;
    if (!optimiser) return s.best;
    Coordinates v = Coordinates::Zero(n);
    if (p.constrained && p.samples) {
        // Joint limits keep it where it may be.
        s.origin = start;
        s.basis = natural_basis(p, start);
    } else {
        s.origin = Coordinates::Zero(n);
        s.basis = DeviceJacobian(kind.configuration_scale.asDiagonal());
        const ConfigurationBox box = search_box(*p.model);
        const Coordinates low = box.low.cwiseQuotient(kind.configuration_scale);
        const Coordinates high = box.high.cwiseQuotient(kind.configuration_scale);
        v = start.cwiseQuotient(kind.configuration_scale).cwiseMax(low).cwiseMin(high);
        nlopt_set_lower_bounds(s.optimiser, low.data());
        nlopt_set_upper_bounds(s.optimiser, high.data());
    }
    nlopt_set_min_objective(s.optimiser, objective_callback, &s);
    if (p.constrained) {
        const Eigen::Matrix<double, 2 * max_device_dimension, 1> tolerances =
            Eigen::Matrix<double, 2 * max_device_dimension, 1>::Constant(1e-9);
        nlopt_add_inequality_mconstraint(s.optimiser, 2 * unsigned(kind.joint_count), constraint_callback, &s,
                                         tolerances.data());
    }
    nlopt_set_xtol_abs1(s.optimiser, p.settings->tolerance);
    nlopt_set_ftol_rel(s.optimiser, p.settings->tolerance * p.settings->tolerance);
    nlopt_set_maxeval(s.optimiser, p.settings->evaluations);
    double value = 0;
    const nlopt_result end = nlopt_optimize(s.optimiser, v.data(), &value);
    s.best.end = end == NLOPT_MAXEVAL_REACHED ? DescentEnd::budget
                 : end < 0                    ? DescentEnd::failed
                                              : DescentEnd::converged;
    return s.best;
}

Coordinates project_to_workspace(const DeviceModel& model, const Coordinates& w) {
    if (!w.allFinite()) return model.rest;
    if (inside_workspace(model, w)) return w;
    if (model.kind->open_chain) return w.cwiseMax(model.joint_min).cwiseMin(model.joint_max);
    MatchingSettings settings;
    settings.tolerance = 1e-8;
    settings.evaluations = 200;
    SlsqpProblem p;
    p.model = &model;
    p.settings = &settings;
    p.previous = w;
    return minimise(p, model.rest).w;
}

}  // namespace palpate
