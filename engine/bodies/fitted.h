#pragma once
// Numbers of the solve of bodies that no law gives: each with what it was chosen on. The grasps of the repository, the
// tests `Bodies`, `Grasp`, `Crowd`, `Energy` and `FingerPairs`, and the stress suite run with them; change one, and run
// those again. Numbers that a user may trade are settings instead.

namespace palpate::fitted {

// --- Flight (rigid_body.cpp) ---
/// A free rotation is found in parts that turn by no more than this [rad], at most so many (`Flight.TumblesAsEuler*`:
/// the energy of a rod that tumbles at 70 rad/s had doubled in 0.2 s with steps of 20 ms).
inline constexpr double turn_at_once = 0.15;
inline constexpr int most_turns = 64;

// --- Which bodies may touch, and how stiffly they do (islands.cpp, body_contact.cpp) ---
/// Pairs are looked at from so far on, beside what they may move in the step [m].
inline constexpr double near_gap = 1e-3;
/// Least penalty of a contact between bodies [N/m], and at least so many times the lighter one's mass / dt^2 (tests
/// `Bodies`: inclines, bounces, balls that roll).
inline constexpr double least_pair_penalty = 2e5, pair_inertia_share = 30;
/// Under its load no contact gives way farther than this (S4 and S5 of the stress suite: a light body under a load)
/// [m].
inline constexpr double deepest_under_load = 1e-4;
/// Gaps are no better known than this (a mesh's smooth field is of floats: a box at rest on one took 200 iterations in
/// every step) [m].
inline constexpr double rounded_gap = 2e-10;
/// A force on a body that is a smaller share of what moves it is the rounding of a difference of velocities.
inline constexpr double rounded_share = 1e-9;
/// Solves that end early leave some hundredths of a millimetre of overlap; what is deeper was there before, and is
/// undone until it is shallower than the second [m], or than this share of what a step undoes: what is left goes at
/// once, which is a speed.
inline constexpr double overlap_begins = 1e-4, overlap_ends = 1e-5, overlap_ends_share = 0.2;
/// No solve has left that of what was not near before: more than this is no contact's to push apart (a stack that began
/// with 0.08 mm of it hopped at 80 mm/s in steps of 1 ms, at 800 in steps of 0.1) [m]; or than this share of what a
/// step undoes.
inline constexpr double overlap_of_fresh = 1e-6, overlap_of_fresh_share = 0.02;
/// The point of an edge that counts follows the deepest one where that is within the second of these [m] (a can that
/// lies on rails rolls off them by itself where it does not), and is another one where that is deeper by more than the
/// first [m]; found by so many sections.
inline constexpr double edge_depth = 1e-5, edge_follows = 5e-4;
inline constexpr int edge_sections = 24;
/// A disc is blunt below the tilt at which its rim would be so many times deeper than the contact gives way under its
/// load; within these bounds [rad] (`Bodies.ACylinderThatComesToStand*`).
inline constexpr double blunt_per_give = 4, least_blunt = 1e-6, most_blunt = 0.05;
/// And the normal at its middle tells its deepest point where its tilt is so many times what a mesh's normals differ by
/// under it; else the deepest of so many points of its rim does (`MeshObject.ACylinderStandsOnTriangles`).
inline constexpr double steady_tilt = 1e5;
inline constexpr int rim_samples = 12;
/// Points that go round by nearly half a revolution in a step slip as ones that go by twice this [rad].
inline constexpr double widest_span = 1.5;
/// Corners are round by this [m], or a fiftieth of the smallest half edge. (With five times as much boxes on boxes tip
/// a degree early.)
inline constexpr double corner_radius = 2e-4;
/// A feature that moves by more than this against an object in a step [m] is followed, at so many places, through what
/// it may meet.
inline constexpr double least_crossing = 5e-4;
inline constexpr int crossing_samples = 16;
/// Bodies that would be deeper in each other at the end of a step, without contact, begin it where they were [m].
inline constexpr double deepest_guess = 1e-3;
/// Normals are of one face where their cosine is above the first of these, and of one plane above the second.
inline constexpr double one_face = 0.7, same_face = 0.98;

// --- The solve (solve_bodies.cpp) ---
/// What may be left unbalanced of a body's weight, however hard it is gripped (a gram under a hard grip).
inline constexpr double unbalanced_weight = 2e-5;
/// Newton steps of a plane between fingers are held back by this share of the tissue's stiffness, and by so many
/// roundings of the contact's penalty (`FingerPairs`).
inline constexpr double plane_tissue_share = 1e-3, plane_roundings = 1600;
/// Least stiffness that penalties give a strain limit, and a contact, over mass / dt^2 of the body that presses on it.
/// A multiplier that is updated once a step, while Newton has not come to its end, integrates what the penalty leaves
/// open; with a penalty near mass / dt^2 that integral swings (of m p^3 + k = 0, p = 1 - 1/z, two roots then have |z|
/// near 1). Chosen on `hold_mug`, `hold_ball`, `pinch` and `egg` with two iterations a step: limits at 8 times still
/// let grasped bodies shake, at 120 times Newton no longer keeps up; stiffer contacts slow it down at once.
inline constexpr double limits_over_inertia = 25, contacts_over_inertia = 1;
/// A bone that is held less stiffly than this takes part of the push up: nothing was gained by stiffer contacts there,
/// and limits need be no stiffer than so many times their penalty (beyond, in steps of 0.2 ms with one iteration, a
/// body of 0.5 kg that met such a finger came back with 48 times its energy; `Energy`: balls of 1 to 500 g that meet a
/// finger held with 2 to 1,000 N/mm) [N/m].
inline constexpr double stiffly_held = 1e4, softly_held_scale = 64;
/// Largest penalties against inertia, as multiples of those of tissue (the same balls: no preset gains energy).
inline constexpr double largest_scale_double = 1e5, largest_scale_float = 4e3;

/// In single precision a body is balanced to so many times what rounding makes of the residuals of its fingers, whose
/// samples all press on it (`pinch` at rest: 0.04 to 0.08 mN of 6.6 N were left, where 0.06 were asked for, so that
/// half the steps spent another iteration on it; `two_hands`: 1.6 to 2 mN of 46 N after 200 iterations, where 0.6
/// were).
inline constexpr double body_roundings_float = 4;
/// With one iteration a step grasps swing: each step begins as far from balance as the one before ended. A body that
/// was left with more than this share of the contact forces unbalanced, or solved on for it, has no fewer iterations
/// than this in so many steps since, which is cheaper, too (`two_hands` at 1 ms: 0.6 instead of 2.6 ms a step; 7
/// instead of 963 end with more than a tenth unbalanced. Shares of 0.1 to 0.01 and 20 or 50 steps are alike).
inline constexpr double shaken_share = 0.03;
inline constexpr int least_shaken_iterations = 2, steps_shaken = 20;

/// An overlap that updates leave at more than this share of what it was is jammed: so many of them, or one where it is
/// deeper than so much [m] (towers of random scenes: 4 mm after five updates, 0.07 mm after 140).
inline constexpr double jam_share = 0.9, jam_depth = 5e-4;
/// What is deeper than that is not updated while more than this share of contact forces is unbalanced.
inline constexpr double deep_gate = 1e-3;
inline constexpr int most_vain_updates = 3;

// --- Static equilibrium (anchors.cpp) ---
/// What holds a body while its equilibrium is looked for is as stiff as inertia in a step of this [s] (what nothing
/// touches sinks by 0.2 mm in a step); each update makes it slower by this factor, so that what is held softly is found
/// in a few, but not so slow that what it bears, or the weight of what slips off all else, would go much farther than
/// this before the next [m] (a ball that came down on a soft slab was 100 mm below it).
inline constexpr double anchor_time = 5e-3, slower_anchor = 2, farthest_cast = 1e-3, least_borne = 0.4;
/// So much of its weight may be left to it; more, which so many updates in a row leave at no less than this share, is
/// borne by nothing else (`egg`, `pinch`: one or two do, of little, where contacts begin to slip in the same step).
inline constexpr double anchored_weight = 1e-4, vain_anchor = 0.9, little_borne = 0.1;
inline constexpr int most_vain_casts = 3, most_vain_casts_of_little = 12;
/// How far a body may sink in a step of static equilibrium, with room [m].
inline constexpr double farthest_adrift = 5e-3;
/// Skin that presses on a body with more than this share of its weight has hold of it: it takes it along.
inline constexpr double grip_share = 0.1;

// --- Soft objects (soft_contact.cpp) ---
/// Contact with soft objects is not followed along a direction, so that one iteration in a step is one too few; and
/// multipliers at its end are those of the last evaluation only where that left less than so much of what is pending
/// unbalanced. (A finger at rest, 5 mm deep in a slab of 10 kPa: with one iteration 0.7 N became 41 N, with two 0.73.)
inline constexpr int least_soft_iterations = 2;
inline constexpr double soft_gate = 0.5;

// --- Planes between fingers (balance_planes.cpp) ---
/// About as large as the contact of two fingers: what torques on a plane are measured by [m].
inline constexpr double plane_size = 5e-3;
/// Slip is held by no more than so many times the penalty of tissue (`FingerPairs`).
inline constexpr double largest_slip_scale = 16;
/// Levenberg-Marquardt on a plane's six motions: how near to balance, of the forces, in at most so many steps; what
/// damping begins and ends with, and how it shrinks and grows (`FingerPairs`: fingers that slide past each other).
inline constexpr double plane_balance = 1e-10, least_plane_damping = 1e-9, largest_plane_damping = 1e6,
                        less_plane_damping = 0.03, more_plane_damping = 10;
inline constexpr int most_plane_steps = 40;
/// What is corrected after a solve is next to nothing below this share of the load, squared (`FingerPairs`).
inline constexpr double plane_correction = 1e-6;

// --- The end of a step (end_bodies.cpp, brake_gain.cpp) ---
/// Forces of contact that miss what really acted on a body by more than so many times that are no result (random
/// scenes: bodies that turn by a right angle in one step miss it by 100 times, grasps with few iterations by 0.3).
inline constexpr double no_result = 1;
/// And those that miss it by so many times are no load to begin the next step with (a tower of nine bodies that falls
/// in steps of 20 ms: 1e33 N after three steps; grasps with few iterations miss by 1 to 3 times).
inline constexpr double no_load = 10;
/// What meets more slowly does not bounce [m/s].
inline constexpr double least_bounce = 0.05;
/// Of the work of each force on a body so much is known no better, where the step has converged and where not. (What
/// two fingers press with 3 to 50 N each, turn, and bring to a stop: up to 7 % is missed, and all of the spin was taken
/// away for it. Past something round, nearly all of the work is gain.)
inline constexpr double work_share = 0.15, rough_work_share = 1e-3;
/// A height that nothing lifted a body to, and from which a step that ended early takes it back (two discs of
/// triangles, one sliding off the other in steps of 20 ms: one rose by 6 mm) [m].
inline constexpr double least_throw = 5e-4;
/// A body that comes out of an overlap may rise by so many times what is undone (`Crowd`: bodies that turn about a
/// corner; one pressed between two things that leave it no room flew off at 4.5 m/s). Its motion is no velocity: at
/// twice the speed of recovery, a can of 175 g that was pushed aside in every step came to 0.2 m/s (random scene
/// 5237788).
inline constexpr double recovery_lever = 2;
/// A body falls asleep after so many steps at rest (`Bodies`).
inline constexpr int steps_to_sleep = 20;

}  // namespace palpate::fitted
