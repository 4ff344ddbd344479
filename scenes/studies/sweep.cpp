#include "scenes/studies/sweep.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <sstream>

#include "meshes/plain_numbers.h"

namespace palpate {

namespace {

std::vector<SweepTrace::Finger> sample(const Simulation& s) {
    std::vector<SweepTrace::Finger> fingers;
    for (const EntityId finger : s.fingers) {
        const ContactSurface& c = *s.world.contact_surfaces.find(finger);
        SweepTrace::Finger f;
        f.net = c.total;
        f.area = c.touching_area;
        f.pad = pressed_pad(c);
        for (const Matching& m : s.world.matchings)
            if (m.finger == finger) {
                f.platform = m.model.mount * m.model.kind->platform(m.model, m.result.w).centre;
                f.has_platform = true;
            }
        fingers.push_back(std::move(f));
    }
    return fingers;
}

double quantile(std::vector<double> values, double share) {
    if (values.empty()) return 0;
    const auto at = values.begin() + std::ptrdiff_t(share * double(values.size() - 1));
    std::nth_element(values.begin(), at, values.end());
    return *at;
}

using Grid = std::map<std::array<int, 3>, Vec3<double>>;

/// Adds a force to the corners of the cell that it is in.
void spread(const Vec3<double>& force, const Vec3<double>& place, Grid& grid) {
    constexpr double cell = 3e-3;  // the spacing of nodes on a pad of 350 tetrahedra
    std::array<int, 3> low;
    std::array<double, 3> share;
    for (int d = 0; d < 3; ++d) {
        const double at = place[d] / cell;
        low[d] = int(std::floor(at));
        share[d] = at - low[d];
    }
    for (int corner = 0; corner < 8; ++corner) {
        double weight = 1;
        std::array<int, 3> key = low;
        for (int d = 0; d < 3; ++d) {
            const bool upper = corner >> d & 1;
            weight *= upper ? share[d] : 1 - share[d];
            key[d] += upper;
        }
        grid[key] += weight * force;
    }
}

void spread(const PressedPad& pad, double factor, Grid& grid) {
    for (const PressurePoint& p : pressure_points(pad)) spread(factor * p.force, p.place, grid);
}

/// sum |F_i - Fref_i| of one finger; NaN where the samples are others.
double field_distance(const SweepTrace::Finger& a, const SweepTrace::Finger& b, FieldComparison comparison) {
    double sum = 0;
    if (comparison == FieldComparison::grid) {
        Grid difference;
        spread(a.pad, 1, difference);
        spread(b.pad, -1, difference);
        for (const auto& [key, force] : difference) sum += norm(force);
        return sum;
    }
    if (a.pad.field.size() != b.pad.field.size()) return std::nan("");
    for (std::size_t i = 0; i < b.pad.field.size(); ++i) sum += norm(a.pad.field[i] - b.pad.field[i]);
    return sum;
}

}  // namespace

SweepPoint run_point(const std::filesystem::path& scene, const std::vector<std::string>& overrides, double period,
                     int threads, const std::atomic<bool>& stop, SweepTrace& trace) {
    Simulation s = make_simulation(load_scene(scene, overrides), threads);
    SweepPoint point;
    const double dt = s.world.solver.dt;
    point.dt_ms = 1e3 * dt;
    trace.samples.clear();
    double next = period;
    run(s, stop, [&](const StepInputs&, double) {
        // The step that ends nearest to the time that all runs share.
        if (s.world.time + 0.5 * dt < next) return;
        trace.samples.push_back(sample(s));
        next += period;
    });
    const auto total = s.step_series.column("total_us");
    point.median_us = quantile(total, 0.5);
    point.p99_us = quantile(total, 0.99);
    double sum = 0, converged = 0, rows = 0;
    for (double us : total) sum += us;
    point.seconds_per_second = s.world.time > 0 ? 1e-6 * sum / s.world.time : 0;
    for (std::size_t f = 0; f < s.finger_series.size(); ++f) {
        const Series& series = s.finger_series[f];
        for (double v : series.column("limit_violation")) point.limit_violation = std::max(point.limit_violation, v);
        for (double v : series.column("penetration_um")) point.penetration_um = std::max(point.penetration_um, v);
        for (double v : series.column("converged")) converged += v, ++rows;
        point.resets += s.finger_counts[f].resets;
    }
    point.converged = rows > 0 ? converged / rows : 0;
    return point;
}

SweepErrors errors_of(const SweepTrace& trace, const SweepTrace& reference, FieldComparison comparison) {
    double field = 0, net = 0, area = 0, platform = 0, platforms = 0;
    double field_scale = 0, net_scale = 0, area_scale = 0;
    for (std::size_t t = 0; t < std::min(trace.samples.size(), reference.samples.size()); ++t)
        for (std::size_t f = 0; f < reference.samples[t].size(); ++f) {
            const auto &a = trace.samples[t][f], &b = reference.samples[t][f];
            net += norm(a.net - b.net);
            net_scale += norm(b.net);
            area += std::abs(a.area - b.area);
            area_scale += b.area;
            if (a.has_platform) platform += 1e3 * (a.platform - b.platform).norm(), ++platforms;
            field += field_distance(a, b, comparison);
            for (const Vec3<double>& force : b.pad.field) field_scale += norm(force);
        }
    const double nothing = std::nan("");
    return {field_scale > 0 ? field / field_scale : nothing, net_scale > 0 ? net / net_scale : nothing,
            area_scale > 0 ? area / area_scale : nothing, platforms > 0 ? platform / platforms : nothing};
}

double richardson(double change_before, double last_change) {
    if (!(last_change > 0)) return last_change;
    return last_change / (std::clamp(change_before / last_change, 1.26, 2.0) - 1);
}

namespace {

SweepErrors left_after(const SweepErrors& before, const SweepErrors& last) {
    return {richardson(before.field, last.field), richardson(before.net, last.net), richardson(before.area, last.area),
            richardson(before.platform_mm, last.platform_mm)};
}

}  // namespace

ReferenceRun solve_reference(const ReferenceRequest& request, const SweepPlan& plan, SweepReference kind,
                             const std::atomic<bool>& stop) {
    auto solve = [&](double dt_ms, int elements) {
        PlainText step;
        step << "dt_ms=" << dt_ms;
        std::vector<std::string> overrides = request.overrides;
        overrides.insert(overrides.end(), {"solver.preset=reference", step.str()});
        std::string what = "at " + step.str().substr(6) + " ms";
        if (elements > 0) {
            for (const std::string& name : plan.fingers)
                overrides.push_back("finger." + name + ".elements=" + std::to_string(elements));
            what += " with " + std::to_string(elements) + " tetrahedra";
        }
        if (request.progress) request.progress("reference " + what);
        SweepTrace trace;
        run_point(request.scene, overrides, request.period, request.threads, stop, trace);
        return trace;
    };
    ReferenceRun r;
    // Of meshes, the coarsest of three tells what the step leaves. Each has four times the elements of the one before,
    // edges of about 0.63 times the length: meshes that are not nested differ by chance, too.
    const bool mesh = kind == SweepReference::mesh;
    // With fewer than 250 elements fingers are uniform, another kind of mesh.
    const int finest = std::max(2 * plan.finest_elements, 16 * 250), coarsest = mesh ? finest / 16 : 0;
    const double dt = request.dt_ms;
    const SweepTrace fourfold = solve(4 * dt, coarsest), twofold = solve(2 * dt, coarsest);
    r.trace = solve(dt, coarsest);
    const auto by_sample = FieldComparison::samples, by_grid = FieldComparison::grid;
    r.uncertainty = left_after(errors_of(fourfold, twofold, by_sample), errors_of(twofold, r.trace, by_sample));
    if (!mesh) return r;
    r.comparison = by_grid;
    const SweepTrace middle = solve(dt, finest / 4);
    const SweepErrors change = errors_of(r.trace, middle, by_grid);
    r.trace = solve(dt, finest);
    const SweepErrors of_mesh = left_after(change, errors_of(middle, r.trace, by_grid));
    r.uncertainty.field += of_mesh.field, r.uncertainty.net += of_mesh.net, r.uncertainty.area += of_mesh.area;
    r.uncertainty.platform_mm += of_mesh.platform_mm;
    return r;
}

std::string doubt(const ReferenceRun& reference) {
    const SweepErrors& u = reference.uncertainty;
    if (!std::isfinite(u.net)) return "NOTHING TOUCHES: there is no force to compare; what settings cost says little";
    const bool sure = u.net <= 0.02 && u.field <= 0.05;  // false for a scene without forces, too
    if (sure) return {};
    char text[200];
    plain_snprintf(text, sizeof text,
                   "NOT SURE to 2 %% of the net force and 5 %% of the field: errors below %.3g %% (field) and %.3g %% "
                   "(net) say little",
                   300 * u.field, 300 * u.net);
    return text;
}

bool on_front(const SweepPoint& point, const std::vector<SweepPoint>& all) {
    auto error = [](const SweepPoint& p) { return std::isfinite(p.errors.field) ? p.errors.field : p.errors.net; };
    return !point.failed && std::none_of(all.begin(), all.end(), [&](const SweepPoint& other) {
        return !other.failed && other.seconds_per_second < point.seconds_per_second && error(other) <= error(point);
    });
}

}  // namespace palpate
