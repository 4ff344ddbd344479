#include "scenes/studies/calibration.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <utility>

#include "engine/math/solve_definite.h"
#include "meshes/input_error.h"
#include "meshes/plain_numbers.h"

namespace palpate {

namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;
constexpr double mm = 1e-3, kPa = 1e3;

}  // namespace

std::vector<FitParameter> fit_parameters(const FingerModel& model) {
    std::vector<FitParameter> all;
    auto add = [&](std::string name, double low, double high, bool logarithmic, double unit, auto member) {
        all.push_back({std::move(name), low, high, logarithmic,
                       [=](const FingerModel& m) { return member(const_cast<FingerModel&>(m)) / unit; },
                       [=](FingerModel& m, double v) { member(m) = v * unit; }});
    };
    all.push_back({"young_kPa", 3, 500, true, [](const FingerModel& m) { return m.spec.young_modulus / kPa; },
                   [](FingerModel& m, double v) {  // layers keep their ratio to it
                       for (TissueLayer& l : m.layers)
                           for (double* E : {&l.young_modulus, &l.across}) *E *= v * kPa / m.spec.young_modulus;
                       m.spec.young_modulus = v * kPa;
                   }});
    add("poisson", 0.05, 0.495, false, 1, [](FingerModel& m) -> double& { return m.spec.poisson_ratio; });
    add("low", 0.3, 0.9, false, 1, [](FingerModel& m) -> double& { return m.spec.limit_low; });
    add("high", 1.1, 3, false, 1, [](FingerModel& m) -> double& { return m.spec.limit_high; });
    if (model.mesh.source == FingerMeshRequest::Source::parametric) {
        add("length_mm", 15, 40, false, mm, [](FingerModel& m) -> double& { return m.mesh.shape.length; });
        add("width_mm", 10, 28, false, mm, [](FingerModel& m) -> double& { return m.mesh.shape.width; });
        add("thickness_mm", 8, 24, false, mm, [](FingerModel& m) -> double& { return m.mesh.shape.thickness; });
        add("pad_bulge", 0, 0.4, false, 1, [](FingerModel& m) -> double& { return m.mesh.shape.pad_bulge; });
    }
    for (std::size_t k = 0; k < model.layers.size(); ++k) {
        const std::string layer = "layer_" + std::to_string(k + 1) + "_";
        add(layer + "young_kPa", 3, 5000, true, kPa,
            [k](FingerModel& m) -> double& { return m.layers[k].young_modulus; });
        if (model.layers[k].across > 0)
            add(layer + "across_kPa", 1, 2000, true, kPa,
                [k](FingerModel& m) -> double& { return m.layers[k].across; });
        add(layer + "low", 0.3, 0.95, false, 1, [k](FingerModel& m) -> double& { return m.layers[k].limit_low; });
        add(layer + "high", 1.05, 3, false, 1, [k](FingerModel& m) -> double& { return m.layers[k].limit_high; });
    }
    return all;
}

namespace {

/// Where the bone is led to for a displacement under a force.
double led_to(double displacement, double force) { return displacement + clamp_give * force; }

/// Where a press is simulated: as it was measured, so that nothing is interpolated. Of too many rows, at those that lie
/// evenly along the curve of logarithmic force, close together where it bends: at the strain limits.
std::vector<double> stops_of(const MeasuredCurve& curve, std::size_t most) {
    std::vector<MeasuredPoint> rows;
    for (const MeasuredPoint& p : curve.points)
        if (p.displacement > 0) rows.push_back(p);
    double top = 1e-300;
    for (const MeasuredPoint& p : rows) top = std::max(top, p.force);
    std::vector<double> along, stops;
    double x = 0, y = 0, largest = 0;
    for (const MeasuredPoint& p : rows) {
        largest = std::max(largest, p.force);  // noise makes the way no longer
        const double x_before = std::exchange(x, p.displacement / rows.back().displacement);
        const double y_before = std::exchange(y, std::log(1 + 50 * largest / top) / std::log(51.0));
        along.push_back(along.empty() ? 0 : along.back() + std::hypot(x - x_before, y - y_before));
    }
    const double between = rows.size() > most ? along.back() / double(most - 1) : 0;
    for (std::size_t i = 0; i < rows.size(); ++i)
        if (along[i] >= (1 - 1e-9) * between * double(stops.size()))
            stops.push_back(led_to(rows[i].displacement, rows[i].force));
    std::sort(stops.begin(), stops.end());  // noise of forces
    return stops;
}

/// The fit's working state. Parameters are scaled to [0, 1] between their bounds.
struct Fit {
    FingerModel model;
    std::vector<FitParameter> parameters;
    const std::vector<MeasuredCurve>& data;
    const CalibrationSettings& settings;
    Threads& threads;
    FingerTemplates templates;
    int simulations = 0;
    bool fine = true;  ///< the search goes by fewer stops than what is found is polished and judged with

    std::vector<double> stops(const MeasuredCurve& curve) const {
        const auto few = stops_of(curve, std::size_t(2 * settings.steps)), all = stops_of(curve, std::size_t(-1));
        if (all.size() <= few.size()) return all;
        return stops_of(curve, std::size_t(fine ? 8 * settings.steps : settings.steps * 3 / 2));
    }
    bool search_is_coarse() const {
        return std::any_of(data.begin(), data.end(), [&](const MeasuredCurve& c) {
            const auto set =
                std::count_if(c.points.begin(), c.points.end(), [](auto& p) { return p.displacement > 0; });
            return set == 0 || set > 2 * settings.steps;
        });
    }
    double value(std::size_t k, double u) const {
        const FitParameter& p = parameters[k];
        return p.logarithmic ? p.low * std::pow(p.high / p.low, u) : p.low + (p.high - p.low) * u;
    }
    double scaled(std::size_t k, double v) const {
        const FitParameter& p = parameters[k];
        const double u =
            p.logarithmic ? std::log(v / p.low) / std::log(p.high / p.low) : (v - p.low) / (p.high - p.low);
        return std::clamp(u, 0.0, 1.0);
    }
    FingerModel at(const VectorXd& u) const {
        FingerModel m = model;
        for (std::size_t k = 0; k < parameters.size(); ++k) parameters[k].set(m, value(k, u[std::ptrdiff_t(k)]));
        return m;
    }

    /// Curves of several fingers, [finger][press], all simulated at once.
    std::vector<std::vector<IndentationCurve>> press(const std::vector<FingerModel>& models) {
        std::vector<Indentation> all;
        std::string note;
        double most = 0;
        for (const FingerModel& m : models) {
            FingerSpec f = build_finger(m, templates, note);
            for (std::size_t c = 0; c < data.size(); ++c) {
                for (const MeasuredPoint& p : data[c].points) most = std::max(most, p.force);
                const std::vector<double> stops = this->stops(data[c]);
                // Without displacements: as far as the forces ask for.
                const double depth = stops.empty() ? 0.3 * m.mesh.shape.thickness : stops.back();
                f.name = std::to_string(all.size());
                all.push_back({f, data[c].angle, 0, depth, stops});
            }
        }
        simulations += int(all.size());
        const auto curves = indent(
            all, {.steps = (fine ? 4 : 1) * settings.steps, .force_limit = 1.5 * most, .friction = settings.friction},
            threads);
        std::vector<std::vector<IndentationCurve>> sorted(models.size());
        for (std::size_t i = 0; i < curves.size(); ++i) sorted[i / data.size()].push_back(curves[i]);
        return sorted;
    }

    /// Residuals of one finger in units of the assumed noise.
    VectorXd residuals(const std::vector<IndentationCurve>& curves) const {
        std::vector<double> r;
        for (std::size_t c = 0; c < data.size(); ++c) {
            // Both at the same place of the plate: on a wall, where force is all but independent of displacement, a
            // measured displacement would ask for a force that is far off.
            IndentationCurve held = curves[c];
            for (IndentationPoint& p : held.points) p.displacement = led_to(p.displacement, p.force);
            double most_force = 0, most_area = 0;
            for (const MeasuredPoint& p : data[c].points) {
                most_force = std::max(most_force, p.force);
                if (std::isfinite(p.area)) most_area = std::max(most_area, p.area);
            }
            // Logarithms, as errors are shares; small values, near first touch, count less.
            auto compare = [&](double model, double measured, double most) {
                const double floor = 0.02 * most;
                r.push_back(std::log((std::max(0.0, model) + floor) / (measured + floor)) / settings.noise);
            };
            for (const MeasuredPoint& p : data[c].points) {
                const double led = led_to(p.displacement, p.force);
                if (std::isfinite(led))
                    compare(field_at_displacement(held, led, &IndentationPoint::force), p.force, most_force);
                // By the displacement where it is known: forces are measured with noise of their own.
                if (std::isfinite(p.area))
                    compare(std::isfinite(led) ? field_at_displacement(held, led, &IndentationPoint::area)
                                               : field_at_force(curves[c], p.force, &IndentationPoint::area),
                            p.area, most_area);
            }
        }
        return Eigen::Map<VectorXd>(r.data(), std::ptrdiff_t(r.size()));
    }
    std::vector<VectorXd> residuals_at(const std::vector<VectorXd>& points) {
        std::vector<FingerModel> models;
        for (const VectorXd& u : points) models.push_back(at(u));
        std::vector<VectorXd> r;
        for (const auto& curves : press(models)) r.push_back(residuals(curves));
        return r;
    }
};

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
        const MatrixXd H = J.transpose().lazyProduct(J);
        const VectorXd g = J.transpose().lazyProduct(best.r);
        const double scale = std::max(1e-12, H.diagonal().maxCoeff());
        std::vector<VectorXd> tries;
        std::vector<double> dampings;
        for (double factor : {0.02, 0.3, 5.0, 80.0}) {
            dampings.push_back(std::clamp(damping * factor, 1e-9, 1e6));
            MatrixXd A = H;
            A.diagonal() += dampings.back() * (H.diagonal().array() + 1e-4 * scale).matrix();
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

std::vector<CurveFit> errors_of(const std::vector<IndentationCurve>& curves, const std::vector<MeasuredCurve>& data) {
    std::vector<CurveFit> fits;
    for (std::size_t c = 0; c < data.size(); ++c) {
        CurveFit f{data[c].angle, 0, 0, curves[c]};
        int areas = 0, displacements = 0;
        double most = 0;
        for (const MeasuredPoint& p : data[c].points) most = std::max(most, p.force);
        for (const MeasuredPoint& p : data[c].points) {
            if (p.force < 0.02 * most) continue;
            if (std::isfinite(p.area) && p.area > 0) {
                f.force_area += std::abs(field_at_force(curves[c], p.force, &IndentationPoint::area) / p.area - 1);
                ++areas;
            }
            if (std::isfinite(p.displacement) && p.displacement > 0) {
                f.displacement_force += std::abs(displacement_at_force(curves[c], p.force) / p.displacement - 1);
                ++displacements;
            }
        }
        f.force_area /= areas;  // NaN without any
        f.displacement_force /= displacements;
        fits.push_back(std::move(f));
    }
    return fits;
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

/// Variance of what the same press gives with other stops: forces and areas differ by some thousandths.
double own_noise(const Fit& fit) { return std::pow(2e-3 / fit.settings.noise, 2); }

/// Residuals of neighbouring rows that are alike, as where the model cannot follow the data, are no news each: by how
/// much fewer of them there are, from the correlation of each row with the one before.
double repetition(const Fit& fit, const VectorXd& r) {
    double together = 0, alone = 1e-300;
    for (std::size_t c = 0, i = 0; c < fit.data.size(); ++c) {
        double last_force = 0, last_area = 0;
        for (const MeasuredPoint& p : fit.data[c].points)
            for (auto [value, last] : {std::pair{p.displacement, &last_force}, std::pair{p.area, &last_area}}) {
                if (!std::isfinite(value)) continue;
                const double now = r[std::ptrdiff_t(i++)];
                together += now * *last, alone += now * now;
                *last = now;
            }
    }
    const double alike = std::clamp(together / alone, 0.0, 0.95);
    return (1 + alike) / (1 - alike);
}

void add_intervals(Fit& fit, const Local& local, Calibration& result) {
    const auto n = local.u.size(), rows = local.r.size();
    const double variance =
        std::max(own_noise(fit), local.r.squaredNorm() / double(std::max<std::ptrdiff_t>(1, rows - n))) *
        repetition(fit, local.r);
    const MatrixXd J = wide_jacobian(fit, local.u);
    // Known before: each parameter is in its range, with the variance of that. The data add what they see.
    const MatrixXd precision = MatrixXd::Identity(n, n) + J.transpose().lazyProduct(J) / variance;
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

std::vector<FitParameter> chosen_parameters(const FingerModel& model, const std::vector<std::string>& names) {
    std::vector<FitParameter> chosen;
    const auto all = fit_parameters(model);
    std::vector<std::string> wrong;
    for (const std::string& name : names) {
        const auto it = std::find_if(all.begin(), all.end(), [&](auto& p) { return p.name == name; });
        if (it != all.end()) {
            chosen.push_back(*it);
            continue;
        }
        std::string known;
        for (const FitParameter& p : all) known += (known.empty() ? "" : ", ") + p.name;
        wrong.push_back("'" + name + "' cannot be fitted; this finger has " + known);
    }
    if (names.empty()) wrong.emplace_back("nothing to fit: name at least one parameter");
    if (!wrong.empty()) throw InputError(wrong);
    return chosen;
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
