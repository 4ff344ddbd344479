#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <sstream>

#include "devices/device.h"
#include "meshes/input_error.h"
#include "scenes/program/commands.h"

namespace palpate {

namespace {

struct DeviceArguments {
    std::string kind, pose;
    bool json = false, workspace = false;
};

/// Configuration from "8,-12,23.5": degrees and millimetres, by component.
Coordinates parse_pose(const DeviceKind& kind, const std::string& text) {
    std::istringstream in(text);
    std::string cell;
    std::vector<double> values;
    while (std::getline(in, cell, ',')) {
        char* end = nullptr;
        const double x = std::strtod(cell.c_str(), &end);
        if (cell.empty() || *end || !std::isfinite(x))
            throw InputError("--pose: expected a number, found '" + cell + "'");
        values.push_back(x);
    }
    if (int(values.size()) != int(kind.configuration_names.size()))
        throw InputError("--pose: " + kind.name + " has " + std::to_string(kind.configuration_names.size()) +
                         " components, found " + std::to_string(values.size()));
    Coordinates w(values.size());
    for (std::size_t i = 0; i < values.size(); ++i) {
        w[i] = values[i] * (kind.configuration_is_length[i] ? 1e-3 : degree);
        if (w[i] < kind.configuration_min[i] || w[i] > kind.configuration_max[i]) {
            std::ostringstream message;
            const double unit = kind.configuration_is_length[i] ? 1e-3 : degree;
            message << "--pose: " << kind.configuration_names[i] << " must be between "
                    << kind.configuration_min[i] / unit << " and " << kind.configuration_max[i] / unit << ", found "
                    << values[i];
            throw InputError(message.str());
        }
    }
    return w;
}

double clean(double x) { return x == 0 ? 0.0 : x; }  // no minus zero

nlohmann::json pose_report(const DeviceModel& m, const Coordinates& w) {
    const Platform p = m.kind->platform(m, w);
    const Joints joints = m.kind->joints(m, w);
    const auto margins = joint_margins(m, joints.q);
    nlohmann::json j;
    for (int i = 0; i < joints.q.size(); ++i) {
        j["q_rad"].push_back(clean(joints.q[i]));
        j["margin_low_deg"].push_back(margins[i] / degree);
        j["margin_high_deg"].push_back(margins[joints.q.size() + i] / degree);
        nlohmann::json row;
        for (int k = 0; k < w.size(); ++k)
            row.push_back(clean(joints.dq(i, k) * (m.kind->configuration_is_length[k] ? 1e-3 : 1)));
        j["dq_dw"].push_back(row);
    }
    for (int d = 0; d < 3; ++d) {
        j["p_mm"].push_back(clean(1e3 * p.centre[d]));
        j["n"].push_back(clean(p.normal[d]));
    }
    j["closed"] = joints.closed;
    j["inside"] = inside_workspace(m, w);
    return j;
}

void print_pose(const DeviceModel& m, const Coordinates& w) {
    const nlohmann::json j = pose_report(m, w);
    std::printf("%s at", m.kind->name.c_str());
    for (int k = 0; k < w.size(); ++k)
        std::printf(" %s = %g %s", m.kind->configuration_names[k].c_str(),
                    w[k] / (m.kind->configuration_is_length[k] ? 1e-3 : degree),
                    m.kind->configuration_is_length[k] ? "mm" : "deg");
    std::printf(": %s\n", !j["closed"].get<bool>()  ? "the legs cannot close"
                          : j["inside"].get<bool>() ? "inside the workspace"
                                                    : "outside the joint limits");
    std::printf("platform centre p   %.6f %.6f %.6f mm\nplatform normal n   %.9f %.9f %.9f\n",
                j["p_mm"][0].get<double>(), j["p_mm"][1].get<double>(), j["p_mm"][2].get<double>(),
                j["n"][0].get<double>(), j["n"][1].get<double>(), j["n"][2].get<double>());
    std::printf("joint      q [rad]      q [deg]   to lower   to upper limit [deg]    dq/dw (columns:");
    for (const auto& name : m.kind->configuration_names) std::printf(" %s", name.c_str());
    std::printf("; rad per rad, rad per mm)\n");
    for (std::size_t i = 0; i < j["q_rad"].size(); ++i) {
        std::printf("%5zu %12.9f %12.6f %10.4f %10.4f                ", i + 1, j["q_rad"][i].get<double>(),
                    j["q_rad"][i].get<double>() / degree, j["margin_low_deg"][i].get<double>(),
                    j["margin_high_deg"][i].get<double>());
        for (const auto& x : j["dq_dw"][i]) std::printf(" %13.9f", x.get<double>());
        std::printf("\n");
    }
}

/// Largest value of component `axis` (in direction `sign`) reachable from `centre` by bisection.
double reach(const DeviceModel& m, Coordinates centre, int axis, double sign) {
    const double start = centre[axis];
    double inside = 0,
           outside = sign * ((sign > 0 ? m.kind->configuration_max : m.kind->configuration_min)[axis] - start);
    for (int i = 0; i < 50; ++i) {
        const double middle = 0.5 * (inside + outside);
        centre[axis] = start + sign * middle;
        (inside_workspace(m, centre) ? inside : outside) = middle;
    }
    return start + sign * inside;
}

int print_workspace(const DeviceModel& m, bool json) {
    const DeviceKind& kind = *m.kind;
    const int last = int(kind.configuration_names.size()) - 1;
    // The level band of the last component, then the range of the others across it.
    Coordinates w = Coordinates::Zero(last + 1);
    w[last] = m.rest[last];
    const double low = reach(m, w, last, -1), high = reach(m, w, last, 1);
    nlohmann::json rows = nlohmann::json::array();
    if (!json) {
        std::printf("%s: level platform from dz = %.4f to %.4f mm\n%10s", kind.name.c_str(), 1e3 * low, 1e3 * high,
                    "dz [mm]");
        for (int k = 0; k < last; ++k) std::printf("   %6s from      to [deg]", kind.configuration_names[k].c_str());
        std::printf("\n");
    }
    for (int i = 0; i <= 16; ++i) {
        w[last] = low + (high - low) * (0.001 + 0.998 * i / 16.0);
        nlohmann::json row{{kind.configuration_names[last] + "_mm", 1e3 * w[last]}};
        if (!json) std::printf("%10.3f", 1e3 * w[last]);
        for (int k = 0; k < last; ++k) {
            const double from = reach(m, w, k, -1) / degree, to = reach(m, w, k, 1) / degree;
            row[kind.configuration_names[k] + "_deg"] = {from, to};
            if (!json) std::printf("   %11.3f %11.3f", from, to);
        }
        if (!json) std::printf("\n");
        rows.push_back(row);
    }
    if (json)
        std::printf(
            "%s\n",
            nlohmann::json{{"dz_min_mm", 1e3 * low}, {"dz_max_mm", 1e3 * high}, {"rows", rows}}.dump(2).c_str());
    return 0;
}

int show_device(const DeviceArguments& a) {
    const DeviceKind& kind = *find_kind(a.kind);
    const DeviceModel model = kind.defaults();
    if (a.workspace) return print_workspace(model, a.json);
    const Coordinates w = a.pose.empty() ? model.rest : parse_pose(kind, a.pose);
    if (a.json)
        std::printf("%s\n", pose_report(model, w).dump(2).c_str());
    else
        print_pose(model, w);
    return 0;
}

}  // namespace

Action add_kinematics_command(const Command& program) {
    const Command c = program.subcommand("kinematics", "kinematics of a device kind").formerly("device");
    auto a = std::make_shared<DeviceArguments>();
    c.option("kind", a->kind, "device kind").required().among(kind_names());
    c.option("--pose", a->pose, "configuration, for example 8,-12,23.5 (degrees, degrees, mm); default: rest");
    c.flag("--workspace", a->workspace, "print the reachable region");
    c.flag("--json", a->json, "print as JSON");
    return [a] { return show_device(*a); };
}

}  // namespace palpate
