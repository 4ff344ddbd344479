#pragma once

namespace palpate {

/// What the solve reports for one finger.
struct SkinStatus {
    int newton_iterations = 0;
    int multiplier_updates = 0;
    int backtracks = 0;
    int uphill_steps = 0;      ///< Newton steps that no halving brought to lower energy, and that were taken back
    int extra_iterations = 0;  ///< granted beyond the budget, because forces were far from balanced
    int wrong_sides = 0;       ///< nodes that an object presses on, or lies behind, inside the skin
    bool converged = false;
    bool cut_short = false;      ///< the deadline ended its iteration before it had converged
    bool reset = false;          ///< diverged, and was put back to rest on its target
    double residual_N = 0;       ///< norm of the force residual
    double limit_violation = 0;  ///< worst relative excess over a strain limit
    double penetration_m = 0;    ///< worst
    double contact_force_N = 0;  ///< sum of normal forces
    int limited_elements = 0;    ///< elements at a strain limit
};

}  // namespace palpate
