#include "scenes/program/compare_output.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "scenes/run/wrapped.h"

namespace palpate {

const std::vector<std::string> method_names{"constrained", "unconstrained", "plane", "force"};

namespace {

const char* const method_titles[] = {"constrained optimisation", "unconstrained + projection", "plane fit + projection",
                                     "force matching"};

std::string title_of(const Comparison& c, std::size_t method) {
    const std::string title = method_titles[int(c.methods[method])];
    return c.kind.empty() ? title : c.kind + ", " + title;
}

template <class Of>
Distribution distribution(const std::vector<ComparedStep>& steps, std::size_t m, Of of) {
    std::vector<double> values;
    Distribution d;
    for (const ComparedStep& row : steps) values.push_back(of(row, row.methods[m]));
    if (values.empty()) return d;
    std::sort(values.begin(), values.end());
    for (double v : values) d.mean += v / double(values.size());
    d.p95 = values[std::size_t(0.95 * double(values.size() - 1))];
    d.most = values.back();
    return d;
}

/// What a plot shows of an error.
struct Shown {
    const char *title, *label;
    double RenderingError::*error;
};
constexpr Shown all_shown[] = {{"Force-field error", "sum |F_i - Fbar_i| [N]", &RenderingError::field_N},
                               {"Its normal part", "sum along normals [N]", &RenderingError::normal_N},
                               {"Its shear", "sum across normals [N]", &RenderingError::shear_N}};

/// Error over roll where the finger rolls by more than five degrees, over time elsewhere.
Plot error_plot(const std::vector<Comparison>& comparisons, std::size_t finger, const Shown& shown) {
    const std::vector<ComparedStep>& first = comparisons[0].steps[finger];
    double low = 1e300, high = -1e300;
    for (const ComparedStep& row : first) low = std::min(low, row.roll_deg), high = std::max(high, row.roll_deg);
    const bool rolls = high - low > 5;
    Plot plot{std::string(shown.title) + ", " + comparisons[0].fingers[finger] +
                  (comparisons.back().interrupted ? ", interrupted" : ""),
              rolls ? "roll angle [degrees]" : "time [s]",
              shown.label,
              {},
              {},
              true};
    for (const Comparison& c : comparisons)
        for (std::size_t m = 0; m < c.methods.size(); ++m) {
            Curve curve{title_of(c, m), {}, {}};
            for (const ComparedStep& row : c.steps[finger]) {
                if (rolls && row.virtual_force_N < 0.05 * c.steps[finger].back().virtual_force_N) continue;
                curve.x.push_back(rolls ? std::abs(row.roll_deg) : row.time);
                curve.y.push_back(row.methods[m].error.*shown.error);
            }
            plot.curves.push_back(std::move(curve));
        }
    if (shown.error == &RenderingError::shear_N) {
        Curve wanted{"wanted shear (renders none: all of it)", {}, {}};
        for (const ComparedStep& row : first) {
            wanted.x.push_back(rolls ? std::abs(row.roll_deg) : row.time);
            wanted.y.push_back(row.virtual_shear_N);
        }
        plot.curves.push_back(std::move(wanted));
    }
    for (const ComparedStep& row : first)
        if (row.methods[0].result.constraint_active) {
            plot.markers.push_back({"device limit reached", rolls ? std::abs(row.roll_deg) : row.time});
            break;
        }
    return plot;
}

}  // namespace

MethodFigures figures_of(const std::vector<ComparedStep>& steps, std::size_t m) {
    using Step = ComparedStep;
    auto mean = [&](auto of) { return distribution(steps, m, of).mean; };
    MethodFigures f;
    f.field = distribution(steps, m, [](const Step&, const Step::Method& r) { return r.error.field_N; });
    f.wanted_N = mean([](const Step& s, const Step::Method&) { return s.virtual_force_N; });
    f.normal_N = mean([](const Step&, const Step::Method& r) { return r.error.normal_N; });
    f.shear_N = mean([](const Step&, const Step::Method& r) { return r.error.shear_N; });
    f.net_N = mean([](const Step&, const Step::Method& r) { return r.error.net_N; });
    f.torque_Nmm = mean([](const Step&, const Step::Method& r) { return r.error.torque_Nmm; });
    f.area_mm2 = mean([](const Step&, const Step::Method& r) { return r.error.area_mm2; });
    f.centre_mm = mean([](const Step&, const Step::Method& r) { return r.error.centroid_mm; });
    std::vector<double> times;
    for (const Step& row : steps) {
        f.unconverged += !row.methods[m].converged;
        f.least_squares += row.methods[m].by_least_squares;
        times.push_back(row.methods[m].microseconds);
    }
    std::sort(times.begin(), times.end());
    if (!times.empty()) f.median_us = times[times.size() / 2];
    return f;
}
double wanted_shear(const std::vector<ComparedStep>& steps) {
    double shear = 0;
    for (const ComparedStep& row : steps) shear += row.virtual_shear_N / double(steps.size());
    return shear;
}

Series to_series(const Comparison& c, std::size_t finger) {
    Series s{{"time_s", "roll_deg", "virtual_force_N", "virtual_shear_N"}, {}};
    for (std::size_t m = 0; m < c.methods.size(); ++m)
        for (const char* column :
             {"_field_N", "_normal_N", "_shear_N", "_net_N", "_torque_Nmm", "_area_mm2", "_centroid_mm", "_at_limit",
              "_converged", "_evaluations", "_by_least_squares", "_us"})
            s.columns.push_back(method_names[std::size_t(c.methods[m])] + column);
    for (const ComparedStep& row : c.steps[finger]) {
        for (double v : {row.time, row.roll_deg, row.virtual_force_N, row.virtual_shear_N}) s.values.push_back(v);
        for (const ComparedStep::Method& m : row.methods)
            for (double v :
                 {m.error.field_N, m.error.normal_N, m.error.shear_N, m.error.net_N, m.error.torque_Nmm,
                  m.error.area_mm2, m.error.centroid_mm, double(m.result.constraint_active), double(m.converged),
                  double(m.result.evaluations), double(m.by_least_squares), m.microseconds})
                s.values.push_back(v);
    }
    return s;
}

std::vector<Plot> error_plots(const std::vector<Comparison>& comparisons, std::size_t finger) {
    std::vector<Plot> plots;
    for (const Shown& shown : all_shown) plots.push_back(error_plot(comparisons, finger, shown));
    return plots;
}

void print_table(const Comparison& c, std::size_t finger) {
    const auto& steps = c.steps[finger];
    std::printf("%s%s%s: %zu rendering steps with contact\n", c.fingers[finger].c_str(), c.kind.empty() ? "" : ", ",
                c.kind.c_str(), steps.size());
    std::printf("  %-13s %33s %8s %7s %13s\n", "", "sum |F_i - Fbar_i| [N], share", "normal", "shear", "net, share");
    std::printf("  %-13s %7s %7s %7s %9s %8s %7s %6s %6s\n", "method", "mean", "p95", "largest", "of wanted", "mean N",
                "mean N", "N", "wanted");
    std::vector<MethodFigures> all;
    for (std::size_t m = 0; m < c.methods.size(); ++m) all.push_back(figures_of(steps, m));
    auto name = [&](std::size_t m) { return method_names[std::size_t(c.methods[m])].c_str(); };
    for (std::size_t m = 0; m < all.size(); ++m) {
        const MethodFigures& f = all[m];
        const auto share = [&](double error) { return f.wanted_N > 0 ? 100 * error / f.wanted_N : 0; };
        std::printf("  %-13s %7.4f %7.4f %7.4f %7.1f %% %8.4f %7.4f %6.3f %4.1f %%\n", name(m), f.field.mean,
                    f.field.p95, f.field.most, share(f.field.mean), f.normal_N, f.shear_N, f.net_N, share(f.net_N));
    }
    std::printf("  %-13s %8s %8s %8s %10s %10s %10s\n", "", "torque", "area", "centre", "match us", "not", "by least");
    std::printf("  %-13s %8s %8s %8s %10s %10s %10s\n", "", "N mm", "mm2", "mm", "median", "converged", "squares");
    for (std::size_t m = 0; m < all.size(); ++m) {
        const MethodFigures& f = all[m];
        std::printf("  %-13s %8.3f %8.2f %8.3f %10.0f %10d %10d\n", name(m), f.torque_Nmm, f.area_mm2, f.centre_mm,
                    f.median_us, f.unconverged, f.least_squares);
    }
    std::printf("%s", wrapped(written("wanted shear (friction of the object): %.4f N on average; a platform without "
                                      "friction renders none",
                                      wanted_shear(steps)),
                              "  ")
                          .c_str());
}

}  // namespace palpate
