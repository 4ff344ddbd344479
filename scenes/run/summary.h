#pragma once
// What a run comes to, per finger and for the whole.

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "scenes/run/grasp.h"
#include "scenes/run/simulation.h"

namespace palpate {

/// A step is settled if its solve converged, or left at most this share of the force that holds the finger (or a
/// millinewton) unbalanced: what it reports is true to about that much.
inline constexpr double settled_share = 0.1;
/// Per step of a finger's series: whether it is settled.
std::vector<char> settled_steps(const Series& finger);

struct FingerSummary {
    std::string name;
    double peak_force_N = 0, mean_force_N = 0;  ///< of the total contact force in settled steps; mean while touching
    std::int64_t unsettled_steps = 0;           ///< which neither peak nor mean nor plot shows
    double unsettled_peak_N = 0;                ///< largest contact force that they reported
    double peak_area_mm2 = 0, touching_share = 0;
    double worst_limit_violation = 0, worst_penetration_um = 0;
    double fixed_penetration_um = 0;  ///< worst of skin that rides on the bone, and does not touch
    double mean_iterations = 0, converged_share = 0;
    int resets = 0;
    std::int64_t wrong_side_steps = 0, extended_steps = 0, cut_short_steps = 0, uphill_steps = 0;  ///< as FingerCounts
    std::int64_t rough_steps = 0;  ///< too far from balance to be sent to a thimble
    bool has_device = false;
    double matching_rms_mm = 0;    ///< mean over solves with contact
    double constrained_share = 0;  ///< of solves with contact, at a workspace limit
    double beside_share = 0;       ///< of solves, with contact from beside the pad, which no platform renders
    std::string thimble_mode;
    std::int64_t retreats = 0;  ///< times its tracker fell silent, and its thimble was led to rest
    std::int64_t commands = 0;  ///< of an armed thimble, with a known age
    double command_age_ms = 0, command_age_p99_ms = 0, command_age_worst_ms = 0;  ///< at the wire; median first
};

/// A soft object, as the run leaves it.
struct SoftSummary {
    std::string name;
    int elements = 0;
    double force_N = 0, area_mm2 = 0;  ///< with which all that touches it presses it
    double dent_mm = 0;                ///< how far its surface has moved, at most
    bool converged = true;
    double peak_force_N = 0, deepest_dent_mm = 0;  ///< of the whole run
    double converged_share = 1;                    ///< of its steps
    std::string entered;                           ///< what came in between its samples, in words; empty: nothing
};

struct Summary {
    std::string title;
    double simulated_s = 0, dt_ms = 0;
    std::int64_t steps = 0;
    double step_median_us = 0, step_p99_us = 0, real_time_factor = 0;
    std::vector<std::pair<std::string, double>> system_mean_us;
    double skin_memory_MB = 0;
    /// Of the governor of presets: share of the steps by preset, steps over the deadline, changes; empty without one.
    std::vector<std::pair<std::string, double>> preset_shares;
    double unbalanced_share = 0;  ///< solver.unbalanced_share: below it iterations are spared
    std::int64_t missed_deadlines = 0, cut_short_steps = 0, preset_changes = 0;
    DetailCount detail;
    double filter_delay_ms = 0;  ///< mean over samples and fingers of what filters hold poses back
    std::int64_t rejected_samples = 0, missing_samples = 0, slowed_steps = 0, contact_growths = 0;
    std::string overlap;  ///< the deepest of two objects, in words; empty: none
    std::vector<FingerSummary> fingers;
    std::vector<BodySummary> bodies;
    std::vector<SoftSummary> soft_objects;
    std::vector<std::string> warnings;  ///< about the scene, as loaded
};

Summary summarise(const Simulation& simulation);
std::string to_text(const Summary& summary);
nlohmann::json to_json(const Summary& summary);

}  // namespace palpate
