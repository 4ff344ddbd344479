#pragma once
// Settings of the solve, and the bounds of each.

#include <string>
#include <vector>

#include "devices/range.h"

namespace palpate {

/// Settings of the solve; each approximation has a name.
struct SolverSettings {
    double dt = 0.005;                   ///< [s]
    int newton_iterations = 200;         ///< most linear solves in one step
    double unbalanced_share = 0;         ///< iterations after the first only while more than this share of the contact
                                         ///< force is unbalanced (of 0.33 N at least at 1 ms, less in longer steps),
                                         ///< where no body or soft object is touched; 0: all
    double tolerance = 1e-7;             ///< force residual, relative to the forces acting
    double multiplier_tolerance = 1e-5;  ///< pending change of multipliers, relative to the forces acting
    double multiplier_gate = 0.1;        ///< update multipliers once the residual is below this share of the change
    int contact_iterations = 3;          ///< most linear solves that follow contacts along one Newton direction
    double contact_share = 0.3;          ///< follow while contact leaves more than this share of the residual
    int steadying_iterations = 0;     ///< most linear solves more in a step that would shake a body held by tissue at
                                      ///< its limits (fitted.h: steady_share); 0: none
    int stiffness_steps = 1;          ///< Newton matrices are kept for so many steps; 1: assembled in every iteration
    double limit_tolerance = 1e-3;    ///< relative excess allowed over a strain limit
    double contact_tolerance = 2e-6;  ///< penetration allowed [m]
    int sample_refinement = 1;        ///< 1: contact is decided at nodes; n: at n times as many points along edges
    bool inertia = true;              ///< false: static equilibrium
    double sleep_speed = 1e-6;        ///< a finger near no object, slower than this and with a still target, sleeps
                                      ///< [m/s]; 0 = never
    double detail_penetration = 0;    ///< samples between nodes count only where they would be deeper in an object
                                      ///< than this [m]; 0: always
    double detail_error = 0;          ///< tissue stays linear while this adds no larger a force error, relative to the
                                      ///< contact force; 0 = never
    double detail_tolerance = 0;      ///< skin near no object, off its rest shape by less than this, moves with its
                                      ///< bone as one [m]; 0 = never
    double recovery_speed = 0.05;     ///< at which objects that overlap at the start of a step part [m/s]
    /// Sentences about what is wrong; empty if nothing is.
    std::vector<std::string> validate() const;
};

/// Bounds of the settings above, by their names; validate() and readers of files hold to these alone.
namespace solver_bounds {
inline constexpr Range dt{1e-6, 0.2};
inline constexpr Range newton_iterations{1, 10000};
inline constexpr Range unbalanced_share{0, 1};
inline constexpr Range tolerance{1e-12, 0.1};
inline constexpr Range multiplier_tolerance{1e-12, 0.1};
inline constexpr Range multiplier_gate{1e-6, 1000};
inline constexpr Range contact_iterations{0, 100};
inline constexpr Range contact_share{0, 1};
inline constexpr Range steadying_iterations{0, 100};
inline constexpr Range stiffness_steps{1, 1000};
inline constexpr Range limit_tolerance{1e-8, 0.5};
inline constexpr Range contact_tolerance{1e-10, 1e-2};
inline constexpr Range recovery_speed{1e-4, 10};
inline constexpr Range sample_refinement{1, 8};
inline constexpr Range sleep_speed{0, 1e-2};
inline constexpr Range detail_penetration{0, 1e-2};
inline constexpr Range detail_error{0, 1};
inline constexpr Range detail_tolerance{0, 1e-2};
}  // namespace solver_bounds

}  // namespace palpate
