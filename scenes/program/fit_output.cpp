#include "scenes/program/fit_output.h"

#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "scenes/recording/svg.h"

namespace palpate {

namespace {

std::string percent(double share) {
    if (!std::isfinite(share)) return "-";
    char text[32];
    std::snprintf(text, sizeof text, "%.1f %%", 100 * share);
    return text;
}

}  // namespace

void draw_fit(const std::filesystem::path& path, const Calibration& c, const std::vector<MeasuredCurve>& data) {
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

std::string json_text(const Calibration& c, bool interrupted) {
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
    return j.dump(2);
}

std::vector<std::string> fit_report(const Calibration& c) {
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

}  // namespace palpate
