#pragma once
// Numbers of matching that no law gives: each with what it was chosen on. Tests `Matching`, `EveryKind`, `Objective`
// and `palpate compare` run with them; change one, and run those again. Numbers that a user may trade are
// MatchingSettings.

namespace palpate::fitted {

/// 10 mm off the plane of the points weigh as much as one radian [rad/m].
inline constexpr double plane_lever = 100;
/// One radian weighs as much as 10 mm where directions are searched in which the platform slides along itself [m/rad].
inline constexpr double slide_lever = 0.01;
/// Starts of a search from everywhere: points of Halton's sequence in the workspace.
inline constexpr int starts_everywhere = 64;
/// An objective below this has nothing to gain from other starts [mm^2].
inline constexpr double nothing_to_gain = 1e-6;
/// Another place is gone to where it costs less by this share than going on from the last one: what costs nearly the
/// same is told apart by rounding alone, and the platform would go to and fro (`edge` with `serial-5dof`, at rest).
inline constexpr double clear_gain = 0.02;
/// And by this distance of each sample that touches: less is no reason to throw a platform across the finger (0.05 mm
/// takes its last leaps from a finger that is rolled on a table, and adds a fifth to the errors of `soft_ball`) [mm].
inline constexpr double clear_distance = 0.02;
/// No point of a platform moves farther than this while the same samples count [m].
inline constexpr double trust = 0.004;

}  // namespace palpate::fitted
