#include "scenes/studies/calibration.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>

#include "engine/math/solve_definite.h"
#include "meshes/input_error.h"
#include "meshes/plain_numbers.h"
#include "scenes/studies/fit_state.h"

namespace palpate {

namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

/// Difference step of scaled parameters: residuals are smooth down to the solve's tolerance.
constexpr double difference_step = 4e-3;

/// Residual at u and its Jacobian, by differences towards the inside of the bounds; of a fine fit to both sides and
/// over more, so that the small jumps of areas from node to node, all that is left there, do not lead astray.
VectorXd linearise(Fit& fit, const VectorXd& u, MatrixXd& J) {
    const double step = (fit.fine ? 3 : 1) * difference_step;
    std::vector<VectorXd> ahead, behind;
    for (std::ptrdiff_t k = 0; k < u.size(); ++k) {
        ahead.push_back(u), behind.push_back(u);
        ahead.back()[k] += u[k] > 0.5 ? -step : step;
        behind.back()[k] = std::clamp(2 * u[k] - ahead.back()[k], 0.0, 1.0);
    }
    std::vector<VectorXd> points = ahead;
    if (fit.fine) points.insert(points.end(), behind.begin(), behind.end());
    points.push_back(u);
    const auto r = fit.residuals_at(points);
    J.resize(r[0].size(), u.size());
    for (std::ptrdiff_t k = 0; k < u.size(); ++k) {
        const std::size_t i = std::size_t(k), from = fit.fine ? i + ahead.size() : r.size() - 1;
        J.col(k) = (r[i] - r[from]) / (points[i][k] - points[from][k]);
    }
    return r.back();
}

/// J' J.
MatrixXd products_of_columns(const MatrixXd& J) {
    MatrixXd H(J.cols(), J.cols());
    for (std::ptrdiff_t i = 0; i < J.cols(); ++i)
        for (std::ptrdiff_t j = 0; j < J.cols(); ++j) H(i, j) = J.col(i).dot(J.col(j));
    return H;
}

/// Minimises 1/2 d' H d + g' d with u + d in [0, 1]: parameters that would leave are put on their bound, one by one.
VectorXd step_in_box(const MatrixXd& H, const VectorXd& g, const VectorXd& u) {
    const auto n = u.size();
    VectorXd d = VectorXd::Zero(n);
    std::vector<char> fixed(std::size_t(n), 0);
    for (std::ptrdiff_t round = 0; round <= n; ++round) {
        MatrixXd A = H;
        VectorXd b = -g;
        for (std::ptrdiff_t k = 0; k < n; ++k)
            if (fixed[std::size_t(k)]) b -= H.col(k) * d[k];
        for (std::ptrdiff_t k = 0; k < n; ++k)
            if (fixed[std::size_t(k)]) {
                A.row(k).setZero(), A.col(k).setZero();
                A(k, k) = 1, b[k] = d[k];
            }
        if (!solve_definite(A, b)) return d;
        d = b;
        std::ptrdiff_t worst = -1;
        double outside = 1e-12;
        for (std::ptrdiff_t k = 0; k < n; ++k)
            if (const double over = std::max(-(u[k] + d[k]), u[k] + d[k] - 1); !fixed[std::size_t(k)] && over > outside)
                outside = over, worst = k;
        if (worst < 0) break;
        fixed[std::size_t(worst)] = 1;
        d[worst] = std::clamp(u[worst] + d[worst], 0.0, 1.0) - u[worst];
    }
    return d;
}

/// Steps of scaled parameters that are nothing beside what differences are taken over.
constexpr double nothing = difference_step / 40;

struct Local {
    VectorXd u, r;
    bool converged = false;
};

/// Levenberg-Marquardt; four dampings are tried at once, as lanes are.
Local fit_from(Fit& fit, VectorXd u, double damping, const std::atomic<bool>& stop,
               const std::function<void(int, double)>& progress) {
    Local best{std::move(u), {}, false};
    MatrixXd J;
    bool moved = true;
    for (int k = 0; k < fit.settings.iterations && !stop; ++k) {
        if (moved) best.r = linearise(fit, best.u, J);
        const double cost = best.r.squaredNorm();
        progress(k, cost / double(best.r.size()));
        const MatrixXd H = products_of_columns(J);
        VectorXd g(J.cols());
        for (std::ptrdiff_t i = 0; i < J.cols(); ++i) g[i] = J.col(i).dot(best.r);
        const double scale = std::max(1e-12, H.diagonal().maxCoeff());
        std::vector<VectorXd> tries;
        std::vector<double> dampings;
        for (double factor : {0.02, 0.3, 5.0, 80.0}) {
            dampings.push_back(std::clamp(damping * factor, 1e-9, 1e6));
            MatrixXd A = H;
            for (std::ptrdiff_t i = 0; i < H.cols(); ++i) A(i, i) += dampings.back() * (H(i, i) + 1e-4 * scale);
            tries.push_back((best.u + step_in_box(A, g, best.u)).cwiseMax(0.0).cwiseMin(1.0));
        }
        const auto r = fit.residuals_at(tries);
        std::size_t chosen = 0;
        for (std::size_t i = 1; i < r.size(); ++i)
            if (r[i].squaredNorm() < r[chosen].squaredNorm()) chosen = i;
        damping = dampings[chosen];
        const double next = r[chosen].squaredNorm();
        moved = next < cost;
        if (!moved) {
            damping = dampings.back();
            best.converged = damping > 1e4 || (tries.front() - best.u).cwiseAbs().maxCoeff() < nothing;
            if (best.converged) break;
            continue;
        }
        const double step = (tries[chosen] - best.u).cwiseAbs().maxCoeff();
        best.u = tries[chosen], best.r = r[chosen];
        best.converged = (cost - next < 1e-4 * cost && step < 1e-2) || step < nothing;
        if (best.converged) break;
    }
    if (best.r.size() == 0) best.r = fit.residuals_at({best.u})[0];  // stopped at once
    return best;
}

/// Points spread over the unit box (Halton), the model's own values first.
std::vector<VectorXd> spread(const Fit& fit, int count) {
    constexpr int primes[] = {2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37};
    const auto n = std::ptrdiff_t(fit.parameters.size());
    std::vector<VectorXd> points(1, VectorXd(n));
    for (std::ptrdiff_t k = 0; k < n; ++k)
        points[0][k] = fit.scaled(std::size_t(k), fit.parameters[std::size_t(k)].get(fit.model));
    for (int i = 1; i < count; ++i) {
        VectorXd u(n);
        for (std::ptrdiff_t k = 0; k < n; ++k) {
            const int base = primes[k % 12];
            double share = 1, x = 0;
            for (int j = i; j > 0; j /= base) share /= base, x += share * (j % base);
            u[k] = 0.05 + 0.9 * x;
        }
        points.push_back(u);
    }
    return points;
}

/// 97.5 % quantile of Student's t (Cornish and Fisher's expansion).
double t_quantile(double freedom) {
    const double z = 1.959964, v = std::max(1.0, freedom);
    return z + (z * z * z + z) / (4 * v) + (5 * std::pow(z, 5) + 16 * z * z * z + 3 * z) / (96 * v * v);
}

/// Jacobian for intervals. The small jumps of an area from node to node must not pass for knowledge: slopes are taken
/// over a wide step, and only as far as both sides of the fit agree on them (the smaller one; none where signs differ).
MatrixXd wide_jacobian(Fit& fit, const VectorXd& u) {
    constexpr double step = 0.02;
    std::vector<VectorXd> points;
    for (std::ptrdiff_t k = 0; k < u.size(); ++k)
        for (double sign : {1.0, -1.0}) {
            points.push_back(u);
            points.back()[k] = std::clamp(u[k] + sign * step, 0.0, 1.0);
        }
    points.push_back(u);
    const auto r = fit.residuals_at(points);
    const VectorXd& here = r.back();
    MatrixXd J(here.size(), u.size());
    for (std::ptrdiff_t k = 0; k < u.size(); ++k) {
        const auto up = std::size_t(2 * k), down = up + 1;
        const double above = points[up][k] - u[k], below = u[k] - points[down][k];
        for (std::ptrdiff_t i = 0; i < here.size(); ++i) {
            const double rise = above > 0 ? (r[up][i] - here[i]) / above : (here[i] - r[down][i]) / below;
            const double fall = below > 0 ? (here[i] - r[down][i]) / below : rise;
            J(i, k) = rise * fall > 0 ? (std::abs(rise) < std::abs(fall) ? rise : fall) : 0;
        }
    }
    return J;
}

void add_intervals(Fit& fit, const Local& local, Calibration& result) {
    const auto n = local.u.size(), rows = local.r.size();
    const double variance =
        std::max(fit.own_noise(), local.r.squaredNorm() / double(std::max<std::ptrdiff_t>(1, rows - n))) *
        fit.repetition(local.r);
    const MatrixXd J = wide_jacobian(fit, local.u);
    // Known before: each parameter is in its range, with the variance of that. The data add what they see.
    MatrixXd precision = products_of_columns(J);
    precision /= variance;
    precision.diagonal().array() += 1;
    const double t = t_quantile(double(rows - n));
    for (std::ptrdiff_t k = 0; k < n; ++k) {
        MatrixXd factor = precision;
        VectorXd covariance = VectorXd::Unit(n, k);
        if (!solve_definite(factor, covariance)) covariance[k] = 1;
        const double half = t * std::sqrt(covariance[k]), u = local.u[k];
        const auto p = std::size_t(k);
        FittedParameter f{fit.parameters[p].name, fit.value(p, u), fit.value(p, std::max(0.0, u - half)),
                          fit.value(p, std::min(1.0, u + half)), true};
        f.determined = half < 0.25 && u > 1e-6 && u < 1 - 1e-6;
        result.parameters.push_back(f);
    }
}

}  // namespace

Calibration calibrate(const FingerModel& start, const std::vector<MeasuredCurve>& data,
                      const CalibrationSettings& settings, Threads& threads, const std::atomic<bool>& stop,
                      const std::function<void(const std::string&)>& progress) {
    Fit fit{start, chosen_parameters(start, settings.parameters), data, settings, threads, {}};
    fit.model.spec.has_limits = true;
    fit.fine = false;
    auto points = spread(fit, std::max(1, 5 * settings.starts));
    const auto r = fit.residuals_at(points);
    if (r[0].size() < std::ptrdiff_t(fit.parameters.size()) + 2)
        throw InputError("the data have " + std::to_string(r[0].size()) + " values; " +
                         std::to_string(fit.parameters.size() + 2) + " are needed for " +
                         std::to_string(fit.parameters.size()) + " parameters");
    std::vector<std::size_t> order(points.size());
    for (std::size_t i = 0; i < order.size(); ++i) order[i] = i;
    std::stable_sort(order.begin(), order.end(),
                     [&](std::size_t a, std::size_t b) { return r[a].squaredNorm() < r[b].squaredNorm(); });
    Local best;
    const auto search = [&](const VectorXd& from, double damping, const std::string& what) {
        return fit_from(fit, from, damping, stop, [&](int k, double cost) {
            char text[120];
            plain_snprintf(text, sizeof text, "%s, iteration %d: mean squared residual %.3f", what.c_str(), k + 1,
                           cost);
            if (progress) progress(text);
        });
    };
    for (int s = 0; s < settings.starts && !stop; ++s) {
        const Local local = search(points[order[std::size_t(s)]], 1e-2,
                                   "start " + std::to_string(s + 1) + " of " + std::to_string(settings.starts));
        if (best.r.size() == 0 || local.r.squaredNorm() < best.r.squaredNorm()) best = local;
    }
    if (best.r.size() == 0) best.u = points[order[0]];  // interrupted
    fit.fine = true;
    if (best.r.size() == 0 || fit.search_is_coarse()) best = search(best.u, 1e-4, "all rows");
    Calibration result;
    result.model = fit.at(best.u);
    result.cost = best.r.squaredNorm() / double(best.r.size());
    result.converged = best.converged;
    add_intervals(fit, best, result);
    result.curves = errors_of(fit.press({result.model})[0], data);
    result.simulations = fit.simulations;
    return result;
}

std::vector<CurveFit> compare_with_curves(const FingerModel& model, const std::vector<MeasuredCurve>& data,
                                          const CalibrationSettings& settings, Threads& threads) {
    Fit fit{model, {}, data, settings, threads, {}};
    return errors_of(fit.press({model})[0], data);
}

}  // namespace palpate
