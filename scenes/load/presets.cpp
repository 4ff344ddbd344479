#include "scenes/load/presets.h"

#include <algorithm>

namespace palpate {

const std::vector<std::string>& preset_names() {
    static const std::vector<std::string> names{"fast", "balanced", "accurate", "reference"};
    return names;
}

void apply_preset(int preset, SolverSettings& v) {
    if (preset == 3) return;
    v.newton_iterations = preset == 2 ? 6 : 2;
    v.unbalanced_share = preset == 2 ? 0 : preset == 1 ? 0.003 : 0.03;
    v.stiffness_steps = 16;
    v.tolerance = 1e-4;
    v.multiplier_tolerance = 1e-3;
}

Governor make_governor(double deadline, int highest, const SolverSettings& asked) {
    Governor g;
    g.deadline = deadline;
    g.asked = asked;
    g.highest = g.preset = highest;
    g.steps.assign(preset_names().size(), 0);
    return g;
}

void govern(Governor& g, double step_seconds, bool cut_short) {
    // What a step of the next preset may take, times that of this one: measured, with room.
    constexpr double dearer[] = {2.5, 3.5, 4};
    constexpr int longest_patience = 120000;
    ++g.steps[std::size_t(g.preset)];
    ++g.in_time;
    ++g.since_up;
    g.longest = std::max(g.longest, step_seconds);
    g.cut_short += cut_short;
    if (step_seconds > g.deadline || cut_short) {
        g.missed += step_seconds > g.deadline;
        if (g.preset > 0) {
            if (g.since_up < g.patience) g.patience = std::min(2 * g.patience, longest_patience);
            --g.preset;
            ++g.changes;
        }
        g.in_time = 0;
        g.longest = 0;
        return;
    }
    if (g.in_time < g.patience) return;
    if (g.preset < g.highest && dearer[g.preset] * g.longest < g.deadline) {
        ++g.preset;
        ++g.changes;
        g.since_up = 0;
    }
    g.in_time = 0;
    g.longest = 0;
}

SolverSettings settings_of(const Governor& g, int preset) {
    SolverSettings s = g.asked;
    if (preset >= g.highest) return s;
    apply_preset(preset, s);
    if (g.highest < 3) s.stiffness_steps = g.asked.stiffness_steps;
    s.steadying_iterations = 0;  // what is to be in time is not solved on
    if (preset == 0) s.newton_iterations = 1, s.unbalanced_share = 0;
    return s;
}

}  // namespace palpate
