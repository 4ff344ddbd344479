#pragma once
// Numbers of matching forces that no law gives: each with what it was chosen on. Tests `ForceMatching`, `TrueReadings`
// and `palpate compare` on `roll`, `hand` and `hold_mug` run with them; change one, and run those again.

namespace palpate::fitted {

/// Pads that are solved side by side: one for the centre, up to six for the Jacobian, the rest for trials.
inline constexpr int lanes_wanted = 8;
/// Differences of the Jacobian, of a component's scale: 0.3 degrees, 0.08 mm.
inline constexpr double difference = 0.02;
/// A sample touches by half where it bears this much: in full from a few mN on [N].
inline constexpr double half_touching = 1e-3;
/// Cosine to the platform at rest (70 degrees) from which on what presses comes from beside the pad (`hand` and
/// `hold_mug`, whose fingers touch each other's sides).
inline constexpr double from_beside = 0.342;
/// Solves that have not converged are believed near balance: off by this share of their force and so many newtons, a
/// limit exceeded, and something entered, by no more than this [N], [m] (`hold_mug`: solves cut short were 618 N off;
/// with a limit exceeded by 0.01, 28 N).
inline constexpr double believed_share = 0.1, believed_noise = 0.02, believed_excess = 1e-3, believed_depth = 2e-5;

}  // namespace palpate::fitted
