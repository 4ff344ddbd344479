#include "scenes/studies/stress/stress.h"

#include "scenes/studies/stress/cases.h"

namespace palpate {

using namespace stress;

const std::vector<StressCase>& stress_cases() {
    static const std::vector<StressCase> cases{
        {"S1", "start states: scrambled, in a point, a plane, a line, mirrored",
         "all recover to 1e-6 in 5 s, none inverted", start_states},
        {"S2", "deformation gradients: rank 0 to 2, mirrored, condition 1e12", "R'R = I to 1e-12, forces to 1e-6",
         deformation_gradients},
        {"S3", "slivers: volumes of 1e-3 to 1e-15 of the mean", "refused by name, or steps; never NaN", slivers},
        {"S4", "Poisson 0 ... 0.4999, E 1 Pa ... 1 GPa, dt 0.01 ... 100 ms, density 1 ... 1e5", "every step converges",
         material_grid},
        {"S5", "neighbours: stiffness 1:1e9, mass 1:1e6", "every step converges; forces balance", unlike_neighbours},
        {"S6", "1000 N press, reached in 0.6 s", "force to 0.1 %, limits to 1e-3, full recovery", heavy_press},
        {"S6b", "1000 N within 0.12 s", "as S6", heavy_blow},
        {"S7", "strain limits of almost exactly 1", "bounded iterations, violation reported", tight_limits},
        {"S8", "contact: inside, two objects in one place, 100 m/s, needle, edge; cards and rods at 0.1 to 10 m/s",
         "finite, bounded; cards keep their side, rods keep it or it is said", contacts},
        {"S9", "friction 0 to 10, slopes at the limit", "sticks below and slides above it, no creep", friction_ends},
        {"S10", "tracker: NaN, zero quaternion, teleport, flip, dropout, backward time",
         "counted; thimble inside its slew limits", tracker_faults},
        {"S11", "matching: singular, at the edge, out of reach, flat, equal bounds",
         "inside the limits, never worse than the last", hard_matches},
        {"S12", "soak: random motion, faults, ten fingers", "finite, no memory growth", soak},
        {"S13", "1 to 32 threads", "the same bits", determinism},
        {"S14", "one finger made NaN", "it resets and says so; neighbours the same bits", one_finger_lost},
    };
    return cases;
}

}  // namespace palpate
