#include <unistd.h>

#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <optional>

#include "meshes/input_error.h"
#include "scenes/program/commands.h"
#include "scenes/program/finger_source.h"
#include "scenes/program/interruption.h"
#include "scenes/recording/svg.h"
#include "scenes/studies/calibration.h"

namespace palpate {

namespace {

struct CalibrateArguments {
    std::string data, out = "finger.toml", plot;
    FingerSource source;
    CalibrationSettings settings;
    int threads = 0;
    bool json = false, quiet = false;
};

void draw(const std::filesystem::path& path, const Calibration& c, const std::vector<MeasuredCurve>& data) {
    Plot force{"Force, measured (dots) and fitted", "displacement [mm]", "force [N]", {}, {}};
    Plot area{"Contact area, measured (dots) and fitted", "force [N]", "area [mm2]", {}, {}};
    for (std::size_t k = 0; k < data.size(); ++k) {
        char label[40];
        std::snprintf(label, sizeof label, "%g degrees", data[k].angle / degree);
        Curve f{label, {}, {}}, a{label, {}, {}}, f_data{std::string(label) + ", data", {}, {}, true},
            a_data{std::string(label) + ", data", {}, {}, true};
        double most = 0;
        for (const MeasuredPoint& p : data[k].points) {
            most = std::max(most, p.force);
            if (std::isfinite(p.displacement)) f_data.x.push_back(1e3 * p.displacement), f_data.y.push_back(p.force);
            if (std::isfinite(p.area)) a_data.x.push_back(p.force), a_data.y.push_back(1e6 * p.area);
        }
        for (int i = 0; i <= 60; ++i) {
            const double at = most * i / 60;
            const IndentationCurve& model = c.curves[k].model;
            f.x.push_back(1e3 * displacement_at_force(model, at)), f.y.push_back(at);
            a.x.push_back(at), a.y.push_back(1e6 * field_at_force(model, at, &IndentationPoint::area));
        }
        if (!f_data.x.empty()) force.curves.insert(force.curves.end(), {f, f_data});
        if (!a_data.x.empty()) area.curves.insert(area.curves.end(), {a, a_data});
    }
    std::vector<Plot> plots;
    for (const Plot& p : {force, area})
        if (!p.curves.empty()) plots.push_back(p);
    write_svg(path, plots);
}

std::string percent(double share) {
    if (!std::isfinite(share)) return "-";
    char text[32];
    std::snprintf(text, sizeof text, "%.1f %%", 100 * share);
    return text;
}

nlohmann::json json_of(const Calibration& c, bool interrupted) {
    auto number = [](double v) { return std::isfinite(v) ? nlohmann::json(v) : nlohmann::json(); };
    nlohmann::json j{{"converged", c.converged}, {"mean_squared_residual", c.cost}, {"simulations", c.simulations}};
    if (interrupted) j["interrupted"] = true;
    for (const FittedParameter& p : c.parameters)
        j["parameters"].push_back({{"name", p.name},
                                   {"value", p.value},
                                   {"low95", p.low95},
                                   {"high95", p.high95},
                                   {"determined", p.determined}});
    for (const CurveFit& f : c.curves)
        j["curves"].push_back({{"angle_deg", f.angle / degree},
                               {"force_area_error", number(f.force_area)},
                               {"displacement_force_error", number(f.displacement_force)}});
    return j;
}

std::vector<std::string> report(const Calibration& c) {
    std::vector<std::string> lines;
    char text[200];
    auto add = [&](auto... values) {
        std::snprintf(text, sizeof text, values...);
        lines.emplace_back(text);
    };
    add("%-20s %10s   %s", "parameter", "value", "95 % interval");
    for (const FittedParameter& p : c.parameters)
        add("%-20s %10.4g   %.4g to %.4g%s", p.name.c_str(), p.value, p.low95, p.high95,
            p.determined ? "" : "   NOT DETERMINED by these data");
    add("%-20s %16s %20s", "press", "area at force", "displacement at force");
    for (const CurveFit& f : c.curves)
        add("%-5g degrees        %16s %20s", f.angle / degree, percent(f.force_area).c_str(),
            percent(f.displacement_force).c_str());
    add("mean squared residual %.2f (1: as the assumed noise), %d presses simulated%s", c.cost, c.simulations,
        c.converged ? "" : "; NOT CONVERGED: more --iterations or fewer parameters");
    return lines;
}

int run_calibrate(const CalibrateArguments& a, const std::atomic<bool>& stop) {
    const auto data = read_measured_curves(a.data);
    std::optional<EndsAtOnce> loading(std::in_place);
    const FingerModel start = load_finger(a.source);
    loading.reset();
    Threads threads(a.threads);
    std::function<void(const std::string&)> progress;
    const bool shown = !a.quiet && isatty(STDERR_FILENO) != 0;
    if (shown) progress = [](const std::string& line) { std::fprintf(stderr, "\r%-78s", line.c_str()); };
    const Calibration c = calibrate(start, data, a.settings, threads, stop, progress);
    if (shown) std::fprintf(stderr, "\r%-78s\r", "");
    const bool interrupted = stop;
    auto lines = report(c);
    if (interrupted) lines.insert(lines.begin(), "INTERRUPTED: the best of what had been tried, and no finished fit");
    FingerModel model = c.model;
    model.title =
        (start.title.empty() ? a.source.name : start.title) + (interrupted ? ", fit interrupted" : ", fitted");
    model.source = "palpate fit " + a.data;
    write_finger_file(a.out, model, lines);
    const std::string plot = a.plot.empty() ? std::filesystem::path(a.out).replace_extension(".svg").string() : a.plot;
    draw(plot, c, data);
    if (a.json) {
        std::printf("%s\n", json_of(c, interrupted).dump(2).c_str());
    } else {
        for (const std::string& line : lines) std::printf("%s\n", line.c_str());
        std::printf("written: %s (in a scene: finger = \"%s\"), %s\n", a.out.c_str(), a.out.c_str(), plot.c_str());
    }
    return interrupted ? 130 : 0;
}

}  // namespace

Action add_fit_command(const Command& program, const std::atomic<bool>& stop) {
    const Command c = program.subcommand("fit", "fit a finger to measured force, displacement and contact area")
                          .formerly("calibrate");
    auto a = std::make_shared<CalibrateArguments>();
    c.option("data", a->data,
             "CSV: force_N, displacement_mm and/or area_mm2, angle_deg (other units: scenes/README.md)")
        .required();
    a->source.name = "index-median";
    add_finger_options(c, "--finger", "what to start from (default: index-median)", a->source);
    c.option("--elements", a->source.elements, "wanted number of tetrahedra (default: as the finger says)")
        .range(20, 200000);
    c.option("--fit", a->settings.parameters,
             "what to fit, separated by commas: young_kPa, poisson, low, high, length_mm, width_mm, thickness_mm, "
             "pad_bulge, layer_1_young_kPa, ... (default young_kPa,low,width_mm)")
        .comma_separated();
    c.option("--starts", a->settings.starts, "local fits from different places").range(1, 100);
    c.option("--iterations", a->settings.iterations, "most of a local fit").range(1, 1000);
    c.option("--steps", a->settings.steps,
             "displacements simulated per press while searching, where more than twice as many were measured")
        .range(4, 1000);
    c.option("--noise", a->settings.noise, "assumed relative error of forces and areas").range(1e-4, 1.0);
    c.option("--friction", a->settings.friction, "of the plate").range(0.0, 10.0);
    c.option("--threads", a->threads, "0: as many as the machine has").range(0, 256);
    c.option("--out", a->out, "finger file to write");
    c.option("--plot", a->plot, "SVG of fit and data (default: beside the finger file)");
    c.flag("--json", a->json, "print the result as JSON");
    c.flag("--quiet", a->quiet, "no progress");
    return [a, &stop] { return run_calibrate(*a, stop); };
}

}  // namespace palpate
