#pragma once
// Numbers of the skin's solve that no law gives: each with what it was chosen on. All scenes of the repository, the
// tests of engine/ and the stress suite run with them; change one, and run those again. Numbers that a user may trade
// are settings (solver_settings.h) instead.

namespace palpate::detail::fitted {

// --- Line search and damping (progress.h) ---
/// A step must bring this share of the decrease that its slope promises (Armijo's condition; Nocedal & Wright,
/// sec. 3.1).
inline constexpr double sufficient_decrease = 1e-4;
/// A line search halves a step so often; what leads uphill then is taken back (random scenes: nothing was gained
/// below).
inline constexpr double smallest_step = 1.0 / 64;
/// Below it a lane has failed, and is put to rest.
inline constexpr double hopeless_step = 1e-6;
/// Energies are known to so many roundings of themselves, and of the finger's extent times the forces on it (float
/// against double on `hand` and `pinch`).
inline constexpr double energy_roundings = 64, extent_roundings = 4;
/// And positions to so many roundings of the extent: what remains of a residual is those times the stiffness.
inline constexpr double position_roundings = 2;
/// Levenberg-Marquardt: damping grows and shrinks by these, between 1 and the largest times the tissue's stiffness;
/// steps longer than the fit count as full ones (scrambled starts, 1,000 N).
inline constexpr double more_damping = 3, less_damping = 0.2, largest_damping = 1e6, full_step = 0.9;
/// Scale of the damping: so many times Young's modulus times the spacing of nodes.
inline constexpr double tissue_stiffness = 5;
/// Iterations of a step with positive curvature before exact curvature is tried: most steps are done by then; hard
/// ones, under large limit forces, converge slowly without it. Steps that are not done after `exact_until` go on with
/// positive curvature alone, which is slower but keeps nearer to the limits (1,000 N against limits of 0.6 and 1.4).
inline constexpr int exact_after = 4, exact_until = 100;
/// Share of exact curvature where the matrix was indefinite, where it was not, and what counts as none.
inline constexpr double less_exact = 0.25, more_exact = 2, hardly_exact = 0.05;

// --- When a step is given more iterations, and when it is not rendered (progress.h) ---
/// A step that has used its budget with forces off balance by more than half the contact force is a spike, felt and
/// seen: it is solved on, by so many iterations at a time, and so many in all (`pinch`, `fast`, 5 ms). Below half, a
/// ball of 5 kg slipped from its grip at 20 ms. Where no contact is left, forces are held against the bone's (random
/// scene 1797610: a box came back with 1.09 times its energy).
inline constexpr double extra_iterations = 4, most_extra_iterations = 40, spike_share = 0.5;
/// What a step leaves unbalanced shakes a body that is held by tissue at its limits: these let nothing give way, so
/// that the next step begins farther off than this one ended, and a grasp never comes to rest. Such a step is solved
/// on, by one iteration at a time, until forces are balanced to this share of the contact force (`hold_mug` on
/// conforming fingers comes to rest from 2e-3 on, `pinch` from 1e-3; at 5e-4 `egg` needs a third more iterations, for
/// nothing).
inline constexpr double steady_share = 1e-3;
/// And until multipliers would change nodal forces by no more than this share of it: what is updated once a step,
/// without an iteration after it, is an integral that lags behind the body and drives it (`two_hands` on conforming
/// fingers: at 1e-2 the box of one mesh of two comes to rest, at 3e-3 and 1e-3 that of all three that were tried).
inline constexpr double steady_pending_share = 3e-3;
/// Where samples between nodes hang on the same nodes as these, what each of them bears is not determined, and moves
/// from one to another for hundreds of updates while forces are balanced and gaps are nanometres: of a soft object,
/// what is nearer to an object than this [m] is not waited for, nor is friction that walks with it (a box that slides
/// on tissue, test `Soft.BodiesSlide...`).
inline constexpr double settled_gap = 2e-8;
/// One that is off by more than a tenth is too rough to be rendered.
inline constexpr double rough_share = 0.1;
/// Multiplier updates of a step, as a multiple of its Newton iterations.
inline constexpr int updates_per_iteration = 4;

// --- The first guess of a step (skin_step.h) ---
/// Where limits act, skin that holds a body coasts on from a step that ended off balance by no more than this share of
/// its contact force: else it moves with its bone, and does not shake the body (`two_hands` and `hold_mug` of preset
/// fingers, `balanced`: at 1e-2 boxes shake, with 14 and 21 % of steps converged, at 3e-3 45 and 21 %, at 0 29 and 11
/// %).
inline constexpr double coasting_share = 3e-3;
/// And where it exceeds no limit by more than this share of it (`palpate new --from press`, net force with `fast` and
/// `balanced` off by 2.5 and 1.0 % at 1e-3, by 0.9 and 0.4 % from 3e-3 on; at 1e-2 boxes slip).
inline constexpr double coasting_excess = 3e-3;

// --- The matrix that is kept (kept_matrix.h) ---
/// A contact's curvature stays in the matrix while it differs by no more than this share (a preset finger that slides,
/// `balanced`: 300 us a step at 0, 152 at 0.03, 150 at 0.1, and at 0.3 more iterations).
inline constexpr double kept_contact_share = 0.03;
/// Iterations of a step that may go by a kept matrix; where a step has fewer, it is not kept while limits act (preset
/// fingers held at their limits with `fast` rocked). The share of its residual below which each must lead, and the
/// steps for which none is kept where it does not, or where other limits act (fingers pressed, slid, turned and rubbed
/// at 1, 5 and 20 ms with `fast` and `balanced`: with 0.3, or without these steps, up to twice the error of steps with
/// matrices of their own; so, the same or less).
inline constexpr int kept_iterations = 2;
inline constexpr double slow_share = 0.1;
inline constexpr int unkept_steps = 8;
/// At most so many, where they are of no use again and again (five fingers pressed at 10 mm/s: a quarter longer
/// without).
inline constexpr int longest_wait = 128;

// --- Iterations that are spared (progress.h) ---
/// What is unbalanced is a share of no less than this [N] in steps of up to so long [s], of less in longer ones, and in
/// tissue that it would dent deeper than so [m] by the stiffness of an element: with the 0.003 of `balanced` 1 mN for a
/// millisecond, about the least that fingertips feel. (`hand` at 1 ms, where fingers leave the table, move freely and
/// graze each other: p99 of a step 0.75 times, its error 0.114 instead of 0.108 %. As much in steps of 20 ms let
/// fingers that graze each other miss: 3.3 instead of 1.3 %.)
inline constexpr double least_balanced_force = 0.33, balanced_within = 1e-3, least_balanced_depth = 7e-4;
/// Of its residual a kept matrix may leave so much there before it is slow, where an iteration is left (`hand` at 1 ms,
/// p99.9 of a step 0.8 times that with 0.1; errors at 1 to 20 ms are the same within 0.02 %).
inline constexpr double spared_slow_share = 0.3;

// --- Penalties (skin_step.h, elements.h, sample_contact.h) ---
/// Multipliers that do not shrink a violation by this from one update to the next get a penalty so much stiffer. It
/// must be free to grow: under 1,000 N a penalty below about 500 times the base leaves the finger free to rock on it,
/// and the multipliers then swing from one side to the other for ever.
inline constexpr double fast_enough = 4, stiffer = 8;
/// At most: beyond, rounding of positions is felt as force, in double and in float.
inline constexpr double stiffest_double = 1e5, stiffest_float = 4e3;
/// What they fall back by per step once they are not needed.
inline constexpr double fall_back = 0.7;
/// Where contact penalties may stay: rounding of positions makes no more force than this share of what is carried.
inline constexpr double felt_rounding = 2e-6;
/// Far outside (violation, and depth [m]), where elements are inverted or objects deep in the skin, a violation that
/// stays says nothing about the multipliers (scrambled starts).
inline constexpr double far_beyond_limits = 3, deep_in_skin = 1e-2;
/// Strain so far below what a limit is at needs no closer look (of its square; the rest is rounding's).
inline constexpr double clearly_within = 0.9;
/// Penalty of a strain limit over its multiplier: below about 2 equilibria under 1,000 N became saddles; at 6 all of
/// the tests' converge, at 20 Newton needs three times the iterations.
inline constexpr double penalty_over_multiplier = 6;
/// Of the scale of a sliding contact's penalty across the normal (friction on the mug's rim).
inline constexpr double stiffest_slip = 16;

// --- What a direction would run into (follow_limits.h) ---
/// Limits that a direction is corrected for, and sweeps over their forces, which change by less than a percent by then
/// (presets pressed to 120 N at 0 to 45 degrees, evaluations in all: none 299 thousand, one 172, two 126, four 80, six
/// 73, eight 72; steps that did not converge 50, 11, 4, 4, 4, 4 of 1021).
inline constexpr int most_walls = 6, wall_sweeps = 30;

// --- Fingers that are lost (skin_step.h) ---
/// A node so many extents away from the bone is nowhere.
inline constexpr double lost_at = 30;
/// Skin beyond this violation and off balance by so many times what pulls at it, for more steps than this, is wound
/// around itself (scrambled starts; nothing that a finger can do leads there).
inline constexpr double tangled_violation = 0.5, tangled_pull = 100;
inline constexpr int tangled_steps = 50;

// --- Linear tissue (elements.h, linear_tissue.h) ---
/// Elements whose stretches are this near a limit are watched while tissue is linear; the others then must not change
/// by more than this share of their distance from it (stretches are known to their rounding).
inline constexpr double watched_margin = 0.05, reach_share = 0.98;

}  // namespace palpate::detail::fitted
