#include "scenes/sweep.h"

#include <algorithm>
#include <cmath>

#include "meshes/input_error.h"

namespace palpate {

SweepAxis parse_axis(const std::string& text) {
    const std::size_t equals = text.find('=');
    SweepAxis axis;
    if (equals != std::string::npos) axis.key = text.substr(0, equals);
    for (std::size_t at = equals + 1; equals != std::string::npos && at <= text.size();) {
        const std::size_t comma = std::min(text.find(',', at), text.size());
        if (comma > at) axis.values.push_back(text.substr(at, comma - at));
        at = comma + 1;
    }
    if (axis.key.empty() || axis.values.empty())
        throw InputError("--axes: expected key=value,value,..., found \"" + text + "\"");
    return axis;
}

std::vector<SweepAxis> default_axes() {
    return {{"dt_ms", {"1", "2", "5", "10", "20"}},
            {"solver.newton_iterations", {"1", "2", "3", "6", "50"}},
            {"solver.precision", {"double", "float"}}};
}

std::vector<std::vector<std::string>> combinations(const std::vector<SweepAxis>& axes) {
    std::vector<std::vector<std::string>> all{{}};
    for (const SweepAxis& axis : axes) {
        std::vector<std::vector<std::string>> longer;
        for (const auto& before : all)
            for (const std::string& value : axis.values) {
                longer.push_back(before);
                longer.back().push_back(value);
            }
        all = std::move(longer);
    }
    return all;
}

std::vector<std::string> overrides_of(const std::vector<SweepAxis>& axes, const std::vector<std::string>& values,
                                      const std::vector<std::string>& finger_names) {
    static const std::string every = "finger.*.";
    std::vector<std::string> overrides;
    for (std::size_t i = 0; i < axes.size(); ++i) {
        if (!axes[i].key.starts_with(every)) {
            overrides.push_back(axes[i].key + "=" + values[i]);
            continue;
        }
        for (const std::string& name : finger_names)
            overrides.push_back("finger." + name + "." + axes[i].key.substr(every.size()) + "=" + values[i]);
    }
    return overrides;
}

namespace {

std::vector<SweepTrace::Finger> sample(const Simulation& s) {
    std::vector<SweepTrace::Finger> fingers;
    for (const EntityId finger : s.fingers) {
        const ContactSurface& c = *s.world.contact_surfaces.find(finger);
        SweepTrace::Finger f;
        f.net = c.total;
        f.area = c.touching_area;
        f.field = c.force;
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
        point.resets += s.finger_resets[f];
    }
    point.converged = rows > 0 ? converged / rows : 0;
    return point;
}

SweepErrors errors_of(const SweepTrace& trace, const SweepTrace& reference) {
    double field = 0, net = 0, area = 0, platform = 0, platforms = 0;
    double field_scale = 0, net_scale = 0, area_scale = 0;
    bool comparable = true;
    for (std::size_t t = 0; t < std::min(trace.samples.size(), reference.samples.size()); ++t)
        for (std::size_t f = 0; f < reference.samples[t].size(); ++f) {
            const auto &a = trace.samples[t][f], &b = reference.samples[t][f];
            net += norm(a.net - b.net);
            net_scale += norm(b.net);
            area += std::abs(a.area - b.area);
            area_scale += b.area;
            if (a.has_platform) platform += 1e3 * (a.platform - b.platform).norm(), ++platforms;
            comparable &= a.field.size() == b.field.size();
            for (std::size_t i = 0; comparable && i < b.field.size(); ++i) {
                field += norm(a.field[i] - b.field[i]);
                field_scale += norm(b.field[i]);
            }
        }
    const double nothing = std::nan("");
    return {comparable && field_scale > 0 ? field / field_scale : nothing, net_scale > 0 ? net / net_scale : nothing,
            area_scale > 0 ? area / area_scale : nothing, platforms > 0 ? platform / platforms : nothing};
}

bool on_front(const SweepPoint& point, const std::vector<SweepPoint>& all) {
    auto error = [](const SweepPoint& p) { return std::isfinite(p.errors.field) ? p.errors.field : p.errors.net; };
    return !point.failed && std::none_of(all.begin(), all.end(), [&](const SweepPoint& other) {
        return !other.failed && other.seconds_per_second < point.seconds_per_second && error(other) <= error(point);
    });
}

}  // namespace palpate
