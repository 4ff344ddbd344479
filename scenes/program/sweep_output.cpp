#include "scenes/program/sweep_output.h"

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <sstream>

#include "scenes/run/wrapped.h"

namespace palpate {

const char* const sweep_columns =
    "field_error,net_error,area_error,platform_mm,seconds_per_second,median_us,p99_us,solver_dt_ms,limit_violation,"
    "penetration_um,converged,resets,failed";

std::string row_of(const SweepPoint& p) {
    std::ostringstream out;
    out.precision(9);
    for (const std::string& v : p.values) out << v << ",";
    out << p.errors.field << "," << p.errors.net << "," << p.errors.area << "," << p.errors.platform_mm << ","
        << p.seconds_per_second << "," << p.median_us << "," << p.p99_us << "," << p.dt_ms << "," << p.limit_violation
        << "," << p.penetration_um << "," << p.converged << "," << p.resets << "," << int(p.failed);
    return out.str();
}

void read_rows(const std::string& text, std::size_t axes, std::map<std::vector<std::string>, SweepPoint>& rows) {
    std::istringstream in(text);
    for (std::string line; std::getline(in, line);) {
        if (line.empty() || line[0] == '#') continue;
        std::vector<std::string> cells;
        std::istringstream cut(line);
        for (std::string cell; std::getline(cut, cell, ',');) cells.push_back(cell);
        if (cells.size() != axes + 13) continue;
        SweepPoint p;
        p.values.assign(cells.begin(), cells.begin() + std::ptrdiff_t(axes));
        auto number = [&](std::size_t i) { return std::strtod(cells[axes + i].c_str(), nullptr); };
        p.errors = {number(0), number(1), number(2), number(3)};
        p.seconds_per_second = number(4), p.median_us = number(5), p.p99_us = number(6), p.dt_ms = number(7);
        p.limit_violation = number(8), p.penetration_um = number(9), p.converged = number(10);
        p.resets = std::int64_t(number(11)), p.failed = number(12) != 0;
        rows[p.values] = p;
    }
}

namespace {

std::string short_key(const std::string& key) { return key.substr(key.rfind('.') + 1); }

/// The axis whose values are curves: that of meshes, or the first one that the first point sets.
std::size_t axis_of_curves(const SweepPlan& plan, const SweepPoint& first) {
    std::size_t axis = plan.keys.size();
    for (std::size_t i = plan.keys.size() - 1; i-- > 0;)
        if (!first.values[i].empty()) axis = i;
    for (std::size_t i = 0; i + 1 < plan.keys.size(); ++i)
        if (!first.values[i].empty() && plan.keys[i].ends_with(".elements")) axis = i;
    return axis;
}

std::string settings_text(const SweepPlan& plan, const SweepPoint& p) {
    std::string text;
    for (std::size_t i = 0; i + 1 < plan.keys.size(); ++i) {
        if (p.values[i].empty()) continue;
        text += (text.empty() ? "" : ", ") + short_key(plan.keys[i]) + " " + p.values[i];
    }
    return text;
}

}  // namespace

Plot work_precision(const std::vector<SweepPoint>& points, const SweepPlan& plan, const ReferenceRun& reference,
                    bool of_a_step) {
    Plot plot{of_a_step ? "A step's time" : "Work and precision",
              of_a_step ? "p99 of a step [ms]" : "compute time per simulated second [s]",
              "force-field error",
              {},
              {},
              true};
    if (reference.comparison == FieldComparison::grid) plot.title += ", meshes (fields on a grid of 3 mm)";
    plot.log_x = true;
    auto time = [&](const SweepPoint& p) { return of_a_step ? 1e-3 * p.p99_us : p.seconds_per_second; };
    const double known = 3 * reference.uncertainty.field;
    Curve below{"below 3 x uncertainty", {}, {}}, failed{"failed", {}, {}}, front{"Pareto front", {}, {}};
    below.points = failed.points = true;
    std::vector<SweepPoint> best;
    const std::size_t axis = axis_of_curves(plan, points.front());
    for (const SweepPoint& p : points) {
        const std::string name =
            p.values[axis].empty() ? "other settings, one by one" : short_key(plan.keys[axis]) + " = " + p.values[axis];
        auto curve = std::find_if(plot.curves.begin(), plot.curves.end(), [&](auto& c) { return c.name == name; });
        if (curve == plot.curves.end()) {
            plot.curves.push_back({name, {}, {}, true});
            curve = plot.curves.end() - 1;
        }
        Curve& into = p.failed ? failed : p.errors.field <= known ? below : *curve;
        into.x.push_back(time(p)), into.y.push_back(p.failed ? 1 : p.errors.field);
        if (!of_a_step && on_front(p, points)) best.push_back(p);
    }
    std::erase_if(plot.curves, [](const Curve& c) { return c.x.empty(); });
    std::sort(best.begin(), best.end(), [](auto& x, auto& y) { return x.seconds_per_second < y.seconds_per_second; });
    for (const SweepPoint& p : best) front.x.push_back(p.seconds_per_second), front.y.push_back(p.errors.field);
    for (Curve* c : {&below, &failed, &front})
        if (!c->x.empty()) plot.curves.push_back(std::move(*c));
    if (of_a_step)
        plot.markers = {{"1 ms", 1}, {"20 ms", 20}};
    else
        plot.markers = {{"real time", 1}};
    return plot;
}

void print_results(const std::vector<SweepPoint>& points, const SweepPlan& plan, const ReferenceRun& r) {
    std::printf("\n%s", wrapped(written("%s: its own uncertainty is %.2g %% of the field, %.2g %% of the net force",
                                        r.comparison == FieldComparison::grid
                                            ? "reference with a finer mesh (fields on a grid of 3 mm)"
                                            : "reference with a finer step",
                                        100 * r.uncertainty.field, 100 * r.uncertainty.net))
                            .c_str());
    if (const std::string unsure = doubt(r); !unsure.empty()) std::printf("%s", wrapped(unsure, "  ").c_str());
    std::printf("\nfastest setting below an error of the force field:\n");
    for (double most : {0.10, 0.05, 0.01}) {
        const SweepPoint* best = nullptr;
        for (const SweepPoint& p : points)
            if (!p.failed && p.errors.field <= most && (!best || p.seconds_per_second < best->seconds_per_second))
                best = &p;
        if (best)
            std::printf("  %4.0f %%: %6.3f s per simulated second, step %.0f us median, %.0f us p99\n%s", 100 * most,
                        best->seconds_per_second, best->median_us, best->p99_us,
                        wrapped(settings_text(plan, *best), "         ").c_str());
        else
            std::printf("  %4.0f %%: no setting of this sweep\n", 100 * most);
    }
    std::printf("\nsettings on the Pareto front\n%9s %9s %9s %10s %10s %9s %9s\n", "field %", "net %", "area %",
                "centre um", "s / s", "p99 us", "limits");
    for (const SweepPoint& p : points)
        if (on_front(p, points))
            std::printf("%9.3f %9.3f %9.3f %10.2f %10.4f %9.0f %9.1e\n%s", 100 * p.errors.field, 100 * p.errors.net,
                        100 * p.errors.area, 1e3 * p.errors.platform_mm, p.seconds_per_second, p.p99_us,
                        p.limit_violation, wrapped(settings_text(plan, p), "    ").c_str());
    int failed = 0;
    for (const SweepPoint& p : points)
        if (p.failed && failed++ < 20) std::printf("%s", wrapped("failed: " + settings_text(plan, p)).c_str());
}

}  // namespace palpate
