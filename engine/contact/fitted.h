#pragma once
// Numbers of contact that no law gives: each with what it was chosen on. Tests `ThinAndFast`, `ThinWalls`, `Distance`
// and `MeshObject` run with them; change one, and run those again.

namespace palpate::fitted {

/// Below such a contact force no step is too rough to be rendered [N].
inline constexpr double rough_from = 0.05;
/// A finger, or a body, whose forces are off balance by more than this share of its contact force (and three times the
/// solver's tolerance), and by more than this [N], has not converged, whatever its island says (random scene 1093: ten
/// fingers under bodies of some grams, in single precision).
inline constexpr double own_residual = 1e-3, own_rounding = 1e-3;
/// Normal forces of which nodes feel less than this share contradict each other, where skin is so deep in something [m]
/// and has not converged (a step of 1 mm on a table, whose lower face is covered: 1e10 N, of which 2 N were felt).
inline constexpr double contradicts_below = 0.1, contradicts_from = 1e-4;
/// A sample that touches bears what presses around it, out to where contact ends: its force over its whole share of the
/// skin is less than the pressure there, by about this factor (a sphere on a deep block, moved over a mesh of 1, 2 and
/// 3 cells across the contact's radius: test `Hertz.AreaBetweenNodes`).
inline constexpr double nodal_gap = 0.65;
/// Boxes, discs and plates that are less than twice this thick remember the side a point is on; in thicker ones the
/// nearest face is the right one (cards of 0.1 and 1 mm met at 0.1 to 10 m/s) [m].
inline constexpr double thin_half = 2.5e-3;
/// Soft objects under bodies have so many samples at least along every edge of their faces. For their samples edges of
/// boxes and rims of cylinders are round, with a radius of this share of the samples' distance, and at most this one of
/// the smallest half extent: nodes before a box in its dent met the face at its front, and held it (boxes, cylinders,
/// capsules and balls of 6 to 40 mm that slide down a slab of 300 to 3,000 elements, test `Soft.BodiesSlide...`).
inline constexpr int tissue_refinement = 3;
inline constexpr double round_edges = 0.9, roundest = 0.5;
/// Skin lies on a face of a box, or on an end of a cylinder, that its normal is against by this cosine, and in which it
/// is no deeper than this [m].
inline constexpr double looks_at_face = 0.8, on_face = 2e-5;
/// Skin wraps an edge where a point of it at the wall is no deeper than this below the face that it looks at, and
/// another one lies on that face, no farther away than that; and where it is on the face, no farther from the rim than
/// the third (ridges, steps and gratings 0.5 to 3 mm high under a finger, test `Seams.RidgesDoNotHoldSkin`; the scenes
/// `edge`, `corner` and `hole`) [m].
inline constexpr double wraps_below = 1e-3, wraps_within = 5e-3, at_rim = 2e-4;
/// Gaps no wider than this between faces that are level to this are bridged: skin spans them, where a sample of it
/// would sink in and hang (keys and tiles 0.2 and 1 mm apart) [m].
inline constexpr double bridge = 1.1e-3, level = 1e-4;
/// Cosine between skin's outward normal and the way into a face, from which on the skin lies on that face, whatever
/// covers it beside: a table's top, of which a box covers a part (steps of 0.5 to 3 mm,
/// `Seams.AStepOnATableIsClimbed`).
inline constexpr double against_face = 0.5;
/// Walls of a mesh go straight down to what it stands on where they are within so much (a cosine) of upright, so many
/// cells of its smooth field high. Cosine between the ways up of what is one ground.
inline constexpr double steep_wall = 0.5, round_foot = 1.5, one_ground = 0.9;

// --- Distances to meshes (mesh_distance_field.cpp, mesh_distance_walls.cpp) ---
/// Rounding of the way from a point to the nearest one of a triangle some centimetres large [m].
inline constexpr double rounded_offset = 1e-15;
/// How far from the surface the smooth field reaches [m].
inline constexpr double contact_band = 3e-3;
/// How many cells thick a wall must be. What the far side takes from the field at the near side follows from the
/// splines' weights: of walls of 2.5 cells at most 0.001 of their thickness, of 2 cells 0.01. Thinner ones get finer
/// cells, those that are too thin for these, too, the exact distance.
inline constexpr double well_resolved = 2.5, resolved = 2;
inline constexpr int most_bricks = 6000;  ///< 24 MB
/// So many of the outermost cells of a smooth field go over to the exact distance.
inline constexpr double rim_cells = 2;
/// Gradients whose square is below this are stretched less and less (rims and thin walls).
inline constexpr double least_gradient2 = 0.16;
/// What of a large object is kept for one finger, beyond twice how far that reaches [m].
inline constexpr double least_near_part = 0.02;
/// Nearer hits are neighbours of where a ray begins [m].
inline constexpr double least_distance = 1e-6;
/// Cosine from which on two sides make a wall (plates of 0.3 to 4 mm, a mug, a wedge).
inline constexpr double facing_away = 0.7;
/// How many points of one mesh are tried for walls.
inline constexpr int most_points = 200000;

}  // namespace palpate::fitted
