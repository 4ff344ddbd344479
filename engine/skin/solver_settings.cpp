#include "engine/skin/solver_settings.h"

#include <sstream>

#include "meshes/plain_numbers.h"

namespace palpate {

std::vector<std::string> SolverSettings::validate() const {
    std::vector<std::string> wrong;
    auto need = [&](const char* name, double value, const Range& range, const char* unit = "") {
        if (range.holds(value)) return;
        PlainText sentence;
        sentence << name << " must be between " << range.low << " and " << range.high << unit << ", found " << value;
        wrong.push_back(sentence.str());
    };
    need("dt", dt, solver_bounds::dt, " s");
    need("newton_iterations", newton_iterations, solver_bounds::newton_iterations);
    need("unbalanced_share", unbalanced_share, solver_bounds::unbalanced_share);
    need("tolerance", tolerance, solver_bounds::tolerance);
    need("multiplier_tolerance", multiplier_tolerance, solver_bounds::multiplier_tolerance);
    need("multiplier_gate", multiplier_gate, solver_bounds::multiplier_gate);
    need("contact_iterations", contact_iterations, solver_bounds::contact_iterations);
    need("contact_share", contact_share, solver_bounds::contact_share);
    need("steadying_iterations", steadying_iterations, solver_bounds::steadying_iterations);
    need("stiffness_steps", stiffness_steps, solver_bounds::stiffness_steps);
    need("limit_tolerance", limit_tolerance, solver_bounds::limit_tolerance);
    need("contact_tolerance", contact_tolerance, solver_bounds::contact_tolerance, " m");
    need("recovery_speed", recovery_speed, solver_bounds::recovery_speed, " m/s");
    need("sample_refinement", sample_refinement, solver_bounds::sample_refinement);
    need("sleep_speed", sleep_speed, solver_bounds::sleep_speed, " m/s");
    need("detail_penetration", detail_penetration, solver_bounds::detail_penetration, " m");
    need("detail_error", detail_error, solver_bounds::detail_error);
    need("detail_tolerance", detail_tolerance, solver_bounds::detail_tolerance, " m");
    return wrong;
}

}  // namespace palpate
