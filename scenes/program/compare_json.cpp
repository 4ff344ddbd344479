#include <nlohmann/json.hpp>

#include "scenes/program/compare_output.h"

namespace palpate {

std::string json_text(const std::vector<Comparison>& comparisons) {
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
    return all.dump(2);
}

}  // namespace palpate
