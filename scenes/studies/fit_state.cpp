#include "scenes/studies/fit_state.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace palpate {

using Eigen::VectorXd;

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

/// Fewer in the search than for what it finds.
std::vector<double> stops_of(const Fit& fit, const MeasuredCurve& curve) {
    const auto few = stops_of(curve, std::size_t(2 * fit.settings.steps)), all = stops_of(curve, std::size_t(-1));
    if (all.size() <= few.size()) return all;
    return stops_of(curve, std::size_t(fit.fine ? 8 * fit.settings.steps : fit.settings.steps * 3 / 2));
}

/// Residuals of one finger in units of the assumed noise.
VectorXd residuals(const Fit& fit, const std::vector<IndentationCurve>& curves) {
    const std::vector<MeasuredCurve>& data = fit.data;
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
            r.push_back(std::log((std::max(0.0, model) + floor) / (measured + floor)) / fit.settings.noise);
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

}  // namespace

bool Fit::search_is_coarse() const {
    return std::any_of(data.begin(), data.end(), [&](const MeasuredCurve& c) {
        const auto set = std::count_if(c.points.begin(), c.points.end(), [](auto& p) { return p.displacement > 0; });
        return set == 0 || set > 2 * settings.steps;
    });
}

double Fit::value(std::size_t k, double u) const {
    const FitParameter& p = parameters[k];
    return p.logarithmic ? p.low * std::pow(p.high / p.low, u) : p.low + (p.high - p.low) * u;
}

double Fit::scaled(std::size_t k, double v) const {
    const FitParameter& p = parameters[k];
    const double u = p.logarithmic ? std::log(v / p.low) / std::log(p.high / p.low) : (v - p.low) / (p.high - p.low);
    return std::clamp(u, 0.0, 1.0);
}

FingerModel Fit::at(const VectorXd& u) const {
    FingerModel m = model;
    for (std::size_t k = 0; k < parameters.size(); ++k) parameters[k].set(m, value(k, u[std::ptrdiff_t(k)]));
    return m;
}

std::vector<std::vector<IndentationCurve>> Fit::press(const std::vector<FingerModel>& models) {
    std::vector<Indentation> all;
    std::string note;
    double most = 0;
    for (const FingerModel& m : models) {
        FingerSpec f = build_finger(m, templates, note);
        for (std::size_t c = 0; c < data.size(); ++c) {
            for (const MeasuredPoint& p : data[c].points) most = std::max(most, p.force);
            const std::vector<double> stops = stops_of(*this, data[c]);
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

std::vector<VectorXd> Fit::residuals_at(const std::vector<VectorXd>& points) {
    std::vector<FingerModel> models;
    for (const VectorXd& u : points) models.push_back(at(u));
    std::vector<VectorXd> r;
    for (const auto& curves : press(models)) r.push_back(residuals(*this, curves));
    return r;
}

double Fit::own_noise() const { return std::pow(2e-3 / settings.noise, 2); }

double Fit::repetition(const VectorXd& r) const {
    double together = 0, alone = 1e-300;
    for (std::size_t c = 0, i = 0; c < data.size(); ++c) {
        double last_force = 0, last_area = 0;
        for (const MeasuredPoint& p : data[c].points)
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

}  // namespace palpate
