#pragma once
// A run as laws see it, step by step.

#include "scenes/studies/random/finger_state.h"
#include "scenes/studies/random/laws.h"

namespace palpate {

/// printf into a string.
[[gnu::format(printf, 1, 2)]] std::string law_text(const char* format, ...);

/// What has been found in one run: the first of each law.
struct Findings {
    std::vector<Violation> all;
    void add(const std::string& law, const std::string& found) {
        for (const Violation& v : all)
            if (v.law == law) return;
        all.push_back({law, found});
    }
};

/// A body after a step.
struct BodyState {
    int object = -1;  ///< row; -1: nothing is known yet
    Pose<double> centre = Pose<double>::identity();
    Vec3<double> velocity{0, 0, 0};          ///< [m/s]
    Vec3<double> angular_momentum{0, 0, 0};  ///< [kg m^2/s]
    bool moves = false;                      ///< neither held until its release nor asleep
};

/// Two objects that overlap more than they may for a while.
struct PairOverlap {
    double depth = -1;   ///< now; below zero: a gap [m]
    double deepest = 0;  ///< so far [m]
    double since = -1;   ///< [s]; -1: they do not
};

/// For how long a finger has touched nothing while its tracked pose stood still.
struct FreeBone {
    double since = -1;                   ///< [s]; -1: it does not
    double distance = 0, half_turn = 0;  ///< of the bone from there when that began [m; sine of half the angle]
};

/// A scene's world seen step by step.
struct Watched {
    const Simulation& s;
    std::vector<FingerState> fingers;  ///< now
    std::vector<FingerState> before;
    std::vector<double> first_energy;      ///< of each body [J]
    std::vector<BodyState> bodies;         ///< now, by their rows
    std::vector<BodyState> bodies_before;  ///< empty in the first step
    std::vector<double> flying_energy;     ///< of turning of each body, when it began to touch nothing [J]; -1: it does
    std::vector<PairOverlap> overlaps;     ///< [object * objects + another of a higher row]
    std::vector<FreeBone> free_bones;      ///< per finger
    bool passed_through = false;           ///< an object has passed through skin, and a step has said so
    double energy_slack = 0;               ///< what a step knows no better of energies of motion, summed [J]
};

/// Forces that rounding of positions makes: no solve is asked for less. The bone's springs are the stiffest [N].
double rounding_of(const Watched& watched, std::size_t finger);
/// Whether a finger's forces are one solve with those of bodies, or of other fingers: then what is left of its own may
/// be as much as fitted::own_rounding.
bool is_in_island(const World& world, std::size_t finger);

}  // namespace palpate
