#include "scenes/studies/sweep_plan.h"

#include <algorithm>
#include <cstdlib>

#include "meshes/input_error.h"
#include "meshes/plain_numbers.h"

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

namespace {

bool changes_mesh(const SweepAxis& axis) {
    return axis.key.ends_with(".elements") || axis.key == "solver.sample_refinement";
}

/// Whether the scene's fingers have surfaces to be meshed, rather than meshes.
bool can_be_refined(const Scene& scene) {
    SweepPlan plan;
    plan.keys = {"finger.*.elements", "reference"};
    for (const FingerSpec& f : scene.spec.fingers) plan.fingers.push_back(f.name);
    try {
        load_scene(scene.file, overrides_of(plan, {"200", "mesh"}));
    } catch (const InputError&) { return false; }
    return true;
}

std::vector<std::vector<std::string>> combinations(const SweepBlock& block, const std::vector<std::string>& keys) {
    std::vector<std::vector<std::string>> all{std::vector<std::string>(keys.size())};
    for (const SweepAxis& axis : block) {
        const auto key = std::size_t(std::find(keys.begin(), keys.end(), axis.key) - keys.begin());
        std::vector<std::vector<std::string>> longer;
        for (const auto& before : all)
            for (const std::string& value : axis.values) {
                longer.push_back(before);
                longer.back()[key] = value;
            }
        all = std::move(longer);
    }
    return all;
}

double finest_dt_ms(const SweepBlock& block, const Scene& scene) {
    for (const SweepAxis& axis : block)
        if (axis.key == "dt_ms") {
            double finest = HUGE_VAL;
            for (const std::string& v : axis.values) finest = std::min(finest, plain_strtod(v.c_str(), nullptr));
            return finest;
        }
    return 1e3 * scene.spec.solver.dt;
}

}  // namespace

std::vector<SweepBlock> default_blocks(const Scene& scene) {
    std::vector<SweepBlock> blocks{{{"dt_ms", {"0.05", "0.2", "1", "2", "5", "10", "20"}},
                                    {"solver.newton_iterations", {"1", "2", "3", "6", "50"}},
                                    {"solver.precision", {"double", "float"}}},
                                   {{"solver.limit_tolerance", {"1e-1", "1e-2", "1e-3", "1e-4"}}},
                                   {{"solver.contact_iterations", {"0", "1", "3"}}}};
    const auto& objects = scene.spec.objects;
    if (std::any_of(objects.begin(), objects.end(), [](auto& o) { return o.friction > 0; }))
        blocks.push_back({{"object.*.friction", {"0"}}});
    if (!scene.spec.fingers.empty() && scene.spec.thimbles.size() == scene.spec.fingers.size()) {
        blocks.push_back({{"finger.*.device.tolerance", {"1e-2", "1e-4", "1e-6"}},
                          {"finger.*.device.solver", {"slsqp", "least-squares"}}});
        blocks.push_back({{"finger.*.device.method", {"unconstrained", "plane"}}});
    }
    if (can_be_refined(scene)) {
        blocks.push_back(
            {{"finger.*.elements", {"200", "350", "700", "1400", "2800"}}, {"solver.newton_iterations", {"2", "50"}}});
        blocks.push_back({{"solver.sample_refinement", {"1", "2", "3"}}});
    }
    return blocks;
}

SweepPlan plan_sweep(const std::vector<SweepBlock>& blocks, const Scene& scene) {
    SweepPlan plan;
    for (const FingerSpec& f : scene.spec.fingers) {
        plan.fingers.push_back(f.name);
        plan.finest_elements = std::max(plan.finest_elements, int(f.mesh.tets.size()));
    }
    for (const ObjectSpec& o : scene.spec.objects) plan.objects.push_back(o.name);
    for (const SweepBlock& block : blocks)
        for (const SweepAxis& axis : block) {
            if (std::find(plan.keys.begin(), plan.keys.end(), axis.key) == plan.keys.end())
                plan.keys.push_back(axis.key);
            if (axis.key.ends_with(".elements"))
                for (const std::string& v : axis.values)
                    plan.finest_elements = std::max(plan.finest_elements, std::atoi(v.c_str()));
        }
    plan.keys.push_back("reference");
    for (const SweepBlock& block : blocks) {
        const bool mesh = std::any_of(block.begin(), block.end(), changes_mesh);
        double& finest = plan.finest_dt_ms[mesh];
        const double here = finest_dt_ms(block, scene);
        finest = finest > 0 ? std::min(finest, here) : here;
        for (auto& point : combinations(block, plan.keys)) {
            point.back() = mesh ? "mesh" : "step";
            if (std::find(plan.points.begin(), plan.points.end(), point) == plan.points.end())
                plan.points.push_back(std::move(point));
        }
    }
    return plan;
}

SweepReference reference_of(const std::vector<std::string>& values) {
    return values.back() == "mesh" ? SweepReference::mesh : SweepReference::step;
}

std::vector<std::string> overrides_of(const SweepPlan& plan, const std::vector<std::string>& values) {
    std::vector<std::string> overrides;
    for (std::size_t i = 0; i + 1 < plan.keys.size(); ++i) {
        const std::string& key = plan.keys[i];
        if (values[i].empty()) continue;
        auto for_all = [&](const std::string& every, const std::vector<std::string>& names) {
            if (!key.starts_with(every + ".*.")) return false;
            for (const std::string& name : names)
                overrides.push_back(every + "." + name + key.substr(every.size() + 2) + "=" + values[i]);
            return true;
        };
        if (!for_all("finger", plan.fingers) && !for_all("object", plan.objects))
            overrides.push_back(key + "=" + values[i]);
    }
    return overrides;
}

}  // namespace palpate
