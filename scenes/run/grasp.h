#pragma once
// Bodies in fingers: what is recorded of them, and what a grasp comes to.

#include <string>
#include <vector>

#include "scenes/run/simulation.h"

namespace palpate {

/// Columns of a body's series: time, pose (of the object's origin), velocity (of its centre of mass), contact force
/// (before its release of fingers and tissue alone), whether fingers alone hold it, balance; then per finger grip,
/// share of the friction in use, slip (way in the step, however short or shaky), slid (way from where it was gripped,
/// to and fro cancelled).
std::vector<std::string> body_columns(const Simulation& simulation);
/// Appends one row to the series of every body.
void record_bodies(Simulation& simulation);

/// A finger's part in a grasp.
struct GripSummary {
    std::string finger;
    double mean_N = 0;        ///< normal force while the body is held, of steps near balance
    double friction_use = 0;  ///< worst share of the Coulomb limit in use while held, of steps near balance
    double slip_mm = 0;       ///< farthest from where it gripped the body, over its surface, while held
    GripReserve reserve;      ///< what it could still resist, before it let go
};

struct BodySummary {
    std::string name;
    double held_s = 0;         ///< time in which fingers alone carried it
    double dropped_at_s = -1;  ///< fingers let go of it in the air; -1: no
    double slip_mm = 0;        ///< the largest of the fingers
    double drift_mm = 0;       ///< way through the world in the last quarter of the hold
    double balance = 0;        ///< median of |contact force + weight - mass x acceleration| / weight while held
    double converged_share = 0;
    int resets = 0;
    std::int64_t unsettled_steps = 0;   ///< of the hold that ended too far from balance to say anything of it
    std::int64_t unbalanced_steps = 0;  ///< of static equilibrium, that have found none for it
    double worst_balance = 0;           ///< of these steps, as a share of its weight
    double slips_at_weights = 0;        ///< grasp_capacity
    std::vector<GripSummary> grips;     ///< of fingers that touched it while held
};

/// Samples with which a finger touches a body now, seen from its centre of mass.
void read_grip(const Simulation& simulation, std::size_t finger, int object, std::vector<GripSample>& grip);

/// How many times its weight a body might weigh before it slips out of all fingers whose samples (about its centre of
/// mass) are given, normal forces as they are: the limit of the whole grasp. Fingers that are not straight opposite
/// each other spend friction on torques and on each other, so this is less than 2 mu N over the weight. What goes along
/// the normals of two flat faces is left to normal forces. 0: nothing holds it, or it weighs nothing.
double grasp_capacity(const std::vector<GripSample>& all, double mass, const Vec3<double>& gravity);

std::vector<BodySummary> summarise_bodies(const Simulation& simulation);

/// What there is to say about a body, as lines of text.
std::string to_text(const std::vector<BodySummary>& bodies);

}  // namespace palpate
