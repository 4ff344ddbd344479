// `palpate compare`: what methods and kinds of device render of a scene, in forces.

#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <optional>

#include "meshes/input_error.h"
#include "scenes/program/commands.h"
#include "scenes/program/interruption.h"
#include "scenes/program/progress.h"
#include "scenes/recording/svg.h"
#include "scenes/run/wrapped.h"
#include "scenes/studies/compare.h"

namespace palpate {

namespace {

const std::vector<std::string> method_names{"constrained", "unconstrained", "plane", "force"};  // as MatchingMethod
const char* const method_titles[] = {"constrained optimisation", "unconstrained + projection", "plane fit + projection",
                                     "force matching"};

/// One run of the scene: one kind of device, several methods.
struct Comparison {
    std::string kind;  ///< empty: as the scene has it
    std::vector<MatchingMethod> methods;
    std::vector<std::string> fingers;
    std::vector<std::vector<ComparedStep>> steps;  ///< per finger
    bool interrupted = false;                      ///< steps are those until then
};

std::string title_of(const Comparison& c, std::size_t method) {
    const std::string title = method_titles[int(c.methods[method])];
    return c.kind.empty() ? title : c.kind + ", " + title;
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

struct CompareArguments {
    std::string scene, out;
    std::vector<std::string> overrides, kinds, methods;
    int threads = 0;
    bool quiet = false, json = false, through_servo = false;
};

struct Distribution {
    double mean = 0, p95 = 0, most = 0;
};
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

/// What came of one method with one finger.
struct MethodFigures {
    Distribution field;
    double wanted_N = 0, normal_N = 0, shear_N = 0, net_N = 0, torque_Nmm = 0, area_mm2 = 0, centre_mm = 0,
           median_us = 0;
    int unconverged = 0, least_squares = 0;
};
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

/// Within 80 columns: errors of forces, then the others.
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

nlohmann::json json_of(const std::vector<Comparison>& comparisons) {
    nlohmann::json all = nlohmann::json::array();
    for (const Comparison& c : comparisons)
        for (std::size_t finger = 0; finger < c.fingers.size(); ++finger) {
            const auto& steps = c.steps[finger];
            nlohmann::json j{
                {"finger", c.fingers[finger]}, {"steps", steps.size()}, {"methods", nlohmann::json::array()}};
            if (!c.kind.empty()) j["kind"] = c.kind;
            if (c.interrupted) j["interrupted"] = true;
            if (!steps.empty()) j["wanted_shear_N"] = wanted_shear(steps);
            for (std::size_t m = 0; m < c.methods.size() && !steps.empty(); ++m) {
                const MethodFigures f = figures_of(steps, m);
                j["methods"].push_back({{"method", method_names[std::size_t(c.methods[m])]},
                                        {"field_mean_N", f.field.mean},
                                        {"field_p95_N", f.field.p95},
                                        {"field_largest_N", f.field.most},
                                        {"wanted_N", f.wanted_N},
                                        {"normal_N", f.normal_N},
                                        {"shear_N", f.shear_N},
                                        {"net_N", f.net_N},
                                        {"torque_Nmm", f.torque_Nmm},
                                        {"area_mm2", f.area_mm2},
                                        {"centroid_mm", f.centre_mm},
                                        {"match_median_us", f.median_us},
                                        {"not_converged", f.unconverged},
                                        {"by_least_squares", f.least_squares}});
            }
            all.push_back(j);
        }
    return all;
}

Comparison compare_kind(const CompareArguments& a, const std::string& kind, const std::atomic<bool>& stop) {
    Comparison c;
    c.kind = kind;
    CompareOptions options;
    options.through_servo = a.through_servo;
    if (!a.methods.empty()) options.methods.clear();
    for (const std::string& name : a.methods) parse_method(name, options.methods.emplace_back());
    c.methods = options.methods;
    std::vector<std::string> overrides = a.overrides;
    std::optional<EndsAtOnce> loading(std::in_place);
    Scene scene = load_scene(a.scene, overrides);
    if (scene.spec.thimbles.empty() || scene.spec.objects.empty())
        throw InputError(a.scene +
                         ": no finger has a device and something to touch; compare needs both (device = { kind = "
                         "\"chinello-3rrs\" })");
    if (!kind.empty()) {
        for (const ThimbleSpec& t : scene.spec.thimbles)
            overrides.push_back("finger." + scene.spec.fingers[std::size_t(t.finger)].name + ".device.kind=" + kind);
        scene = load_scene(a.scene, overrides);
    }
    for (const ThimbleSpec& t : scene.spec.thimbles)
        c.fingers.push_back(scene.spec.fingers[std::size_t(t.finger)].name);
    Simulation simulation = make_simulation(std::move(scene), a.threads);
    loading.reset();
    Progress progress("compare", a.quiet);
    c.steps = compare(simulation, options, stop, [&](double share) { progress.show(share); });
    progress.clear();
    c.interrupted = stop;
    return c;
}

int compare_scene(const CompareArguments& a, const std::atomic<bool>& stop) {
    const std::filesystem::path folder =
        a.out.empty() ? std::filesystem::path("results") / (std::filesystem::path(a.scene).stem().string() + "-compare")
                      : std::filesystem::path(a.out);
    std::vector<Comparison> comparisons;
    for (const std::string& kind : a.kinds.empty() ? std::vector<std::string>{""} : a.kinds)
        if (!stop) comparisons.push_back(compare_kind(a, kind, stop));
    if (comparisons.empty()) return 130;
    std::error_code error;
    std::filesystem::create_directories(folder, error);
    if (error) throw InputError(folder.string() + ": cannot be created: " + error.message());
    std::vector<Plot> plots;
    for (std::size_t f = 0; f < comparisons[0].fingers.size(); ++f) {
        const std::string& finger = comparisons[0].fingers[f];
        for (const Comparison& c : comparisons) {
            write_csv(folder / (finger + (c.kind.empty() ? "" : "-" + c.kind) + "-errors.csv"), to_series(c, f));
            if (a.json) continue;
            if (c.steps[f].empty())
                std::printf("%s: never in contact\n", finger.c_str());
            else if (!a.quiet)
                print_table(c, f);
        }
        if (!comparisons[0].steps[f].empty())
            for (const Shown& shown : all_shown) plots.push_back(error_plot(comparisons, f, shown));
    }
    write_svg(folder / "errors.svg", plots);
    if (a.json)
        std::printf("%s\n", json_of(comparisons).dump(2).c_str());
    else if (!a.quiet)
        std::printf("written to %s (errors.svg, one -errors.csv per finger)\n", folder.string().c_str());
    if (!stop) return 0;
    const bool lacks_kinds = comparisons.size() < a.kinds.size();
    std::fprintf(stderr, "interrupted: what was compared ends there%s\n",
                 lacks_kinds ? ", and kinds of devices are missing" : "");
    return 130;
}

}  // namespace

Action add_compare_command(const Command& program, const std::atomic<bool>& stop) {
    const Command c =
        program.subcommand("compare", "error analysis of rendering methods and devices (Perez et al. 2017, Fig. 7)");
    auto a = std::make_shared<CompareArguments>();
    c.scene("scene", a->scene, "scene file (.toml) or bare name").required();
    c.option("--out", a->out, "folder for results (default: results/SCENE-compare)");
    c.option("--set", a->overrides, "override a value of the scene").repeatable();
    c.option("--methods", a->methods, "constrained, unconstrained, plane, force (default: all)")
        .comma_separated()
        .among(method_names);
    c.option("--kinds", a->kinds, "device kinds to compare (default: the scene's)")
        .comma_separated()
        .among(kind_names());
    c.flag("--servo", a->through_servo, "through the simulated servo: quantised and delayed");
    c.option("--threads", a->threads, "threads (default: all cores)").range(1, 1024);
    c.flag("--quiet", a->quiet, "print nothing but errors");
    c.flag("--json", a->json, "print the figures as JSON");
    return [a, &stop] { return compare_scene(*a, stop); };
}

}  // namespace palpate
