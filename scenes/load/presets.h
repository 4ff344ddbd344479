#pragma once
// Presets of the solve, and the governor that moves between them while a scene runs.

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "engine/world.h"

namespace palpate {

/// Names that `[solver] preset` takes, cheapest first: "fast", "balanced", "accurate", "reference".
const std::vector<std::string>& preset_names();
/// Settings of a preset by its place there; measured in bench/README.md.
void apply_preset(int preset, SolverSettings& settings);

/// Steps down a preset when a step takes longer than its deadline, or is cut short by it (engine/world.h), and up again
/// when there is slack; never above what the scene asks for. A step up that fails doubles the time before the next one
/// (up to two minutes at 1 ms a step), so that it does not swing. Times depend on the machine, so its choices are
/// inputs of a step, and recorded as such.
struct Governor {
    double deadline = 0;     ///< of a step [s]
    SolverSettings asked;    ///< the scene's own, of the highest preset
    int highest = 0;         ///< preset that the scene asks for
    int preset = 0;          ///< of the next step
    int patience = 200;      ///< steps with slack before one up
    int in_time = 0;         ///< steps since the last missed deadline or change
    double longest = 0;      ///< of these [s]
    int since_up = 1 << 30;  ///< steps since the last one up
    std::int64_t missed = 0, cut_short = 0, changes = 0;
    std::vector<std::int64_t> steps;  ///< per preset
};
Governor make_governor(double deadline, int highest, const SolverSettings& asked);
/// Takes in how long a step took, and whether it was cut short; afterwards `preset` is that of the next one.
void govern(Governor& governor, double step_seconds, bool cut_short = false);
/// Settings of the governor's preset; of "fast", with one iteration a step, whatever is left unbalanced.
SolverSettings settings_of(const Governor& governor, int preset);

}  // namespace palpate
