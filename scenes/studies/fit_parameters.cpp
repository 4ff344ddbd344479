#include "scenes/studies/fit_parameters.h"

#include <algorithm>
#include <utility>

#include "meshes/input_error.h"

namespace palpate {

namespace {

constexpr double mm = 1e-3, kPa = 1e3;

}  // namespace

std::vector<FitParameter> fit_parameters(const FingerModel& model) {
    std::vector<FitParameter> all;
    auto add = [&](std::string name, double low, double high, bool logarithmic, double unit, auto member) {
        all.push_back({std::move(name), low, high, logarithmic,
                       [=](const FingerModel& m) { return member(const_cast<FingerModel&>(m)) / unit; },
                       [=](FingerModel& m, double v) { member(m) = v * unit; }});
    };
    all.push_back({"young_kPa", 3, 500, true, [](const FingerModel& m) { return m.spec.young_modulus / kPa; },
                   [](FingerModel& m, double v) {  // layers keep their ratio to it
                       for (TissueLayer& l : m.layers)
                           for (double* E : {&l.young_modulus, &l.across}) *E *= v * kPa / m.spec.young_modulus;
                       m.spec.young_modulus = v * kPa;
                   }});
    add("poisson", 0.05, 0.495, false, 1, [](FingerModel& m) -> double& { return m.spec.poisson_ratio; });
    add("low", 0.3, 0.9, false, 1, [](FingerModel& m) -> double& { return m.spec.limit_low; });
    add("high", 1.1, 3, false, 1, [](FingerModel& m) -> double& { return m.spec.limit_high; });
    if (model.mesh.source == FingerMeshRequest::Source::parametric) {
        add("length_mm", 15, 40, false, mm, [](FingerModel& m) -> double& { return m.mesh.shape.length; });
        add("width_mm", 10, 28, false, mm, [](FingerModel& m) -> double& { return m.mesh.shape.width; });
        add("thickness_mm", 8, 24, false, mm, [](FingerModel& m) -> double& { return m.mesh.shape.thickness; });
        add("pad_bulge", 0, 0.4, false, 1, [](FingerModel& m) -> double& { return m.mesh.shape.pad_bulge; });
    }
    for (std::size_t k = 0; k < model.layers.size(); ++k) {
        const std::string layer = "layer_" + std::to_string(k + 1) + "_";
        add(layer + "young_kPa", 3, 5000, true, kPa,
            [k](FingerModel& m) -> double& { return m.layers[k].young_modulus; });
        if (model.layers[k].across > 0)
            add(layer + "across_kPa", 1, 2000, true, kPa,
                [k](FingerModel& m) -> double& { return m.layers[k].across; });
        add(layer + "low", 0.3, 0.95, false, 1, [k](FingerModel& m) -> double& { return m.layers[k].limit_low; });
        add(layer + "high", 1.05, 3, false, 1, [k](FingerModel& m) -> double& { return m.layers[k].limit_high; });
    }
    return all;
}

std::vector<FitParameter> chosen_parameters(const FingerModel& model, const std::vector<std::string>& names) {
    std::vector<FitParameter> chosen;
    const auto all = fit_parameters(model);
    std::vector<std::string> wrong;
    for (const std::string& name : names) {
        const auto it = std::find_if(all.begin(), all.end(), [&](auto& p) { return p.name == name; });
        if (it != all.end()) {
            chosen.push_back(*it);
            continue;
        }
        std::string known;
        for (const FitParameter& p : all) known += (known.empty() ? "" : ", ") + p.name;
        wrong.push_back("'" + name + "' cannot be fitted; this finger has " + known);
    }
    if (names.empty()) wrong.emplace_back("nothing to fit: name at least one parameter");
    if (!wrong.empty()) throw InputError(wrong);
    return chosen;
}

}  // namespace palpate
