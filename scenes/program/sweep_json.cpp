#include <nlohmann/json.hpp>

#include "scenes/program/sweep_output.h"

namespace palpate {

namespace {

nlohmann::json json_of(const SweepErrors& e) {
    return {{"field", e.field}, {"net", e.net}, {"area", e.area}, {"platform_mm", e.platform_mm}};
}

nlohmann::json json_of(const SweptPoints& swept, const SweepPlan& plan) {
    const ReferenceRun& r = swept.reference;
    nlohmann::json rows = nlohmann::json::array();
    for (const SweepPoint& p : swept.points) {
        nlohmann::json settings = nlohmann::json::object();
        for (std::size_t i = 0; i + 1 < plan.keys.size(); ++i)
            if (!p.values[i].empty()) settings[plan.keys[i]] = p.values[i];
        rows.push_back({{"settings", settings},
                        {"errors", json_of(p.errors)},
                        {"seconds_per_second", p.seconds_per_second},
                        {"step_median_us", p.median_us},
                        {"step_p99_us", p.p99_us},
                        {"dt_ms", p.dt_ms},
                        {"limit_violation", p.limit_violation},
                        {"penetration_um", p.penetration_um},
                        {"converged", p.converged},
                        {"resets", p.resets},
                        {"failed", p.failed},
                        {"on_pareto_front", on_front(p, swept.points)}});
    }
    return {{"reference", swept.kind == SweepReference::mesh ? "mesh" : "step"},
            {"fields_compared", r.comparison == FieldComparison::grid ? "on a grid of 3 mm" : "sample by sample"},
            {"uncertainty", json_of(r.uncertainty)},
            {"doubt", doubt(r)},
            {"points", rows}};
}

}  // namespace

std::string json_text(const std::vector<SweptPoints>& swept, const SweepPlan& plan) {
    nlohmann::json all = nlohmann::json::array();
    for (const SweptPoints& s : swept) all.push_back(json_of(s, plan));
    return all.dump(2);
}

}  // namespace palpate
