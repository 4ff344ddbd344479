#include <sstream>

#include "scenes/run/hardware.h"
#include "scenes/run/summary.h"

namespace palpate {

namespace {

/// What a person should know of a finger before he believes its figures.
void add_remarks(std::ostringstream& out, const FingerSummary& f) {
    char line[400];
    if (1e-3 * f.command_age_p99_ms > longest_command_age) {
        std::snprintf(line, sizeof line,
                      "  %s feels commands late: %.1f ms at the wire (p99; median %.1f, longest %.1f)\n",
                      f.name.c_str(), f.command_age_p99_ms, f.command_age_ms, f.command_age_worst_ms);
        out << line;
    }
    if (f.unsettled_steps) {
        std::snprintf(line, sizeof line,
                      "  %s: %lld steps ended with more than %.0f %% of its force unbalanced; the peak and mean leave "
                      "them out (they reported up to %.3f N)\n",
                      f.name.c_str(), static_cast<long long>(f.unsettled_steps), 100 * settled_share,
                      f.unsettled_peak_N);
        out << line;
    }
    if (f.fixed_penetration_um > 10) {
        std::snprintf(line, sizeof line,
                      "  %s: skin that rides on its bone (nail, back, rim of the cut) was up to %.3f mm inside an "
                      "object: it does not touch, and nothing pushed it out\n",
                      f.name.c_str(), 1e-3 * f.fixed_penetration_um);
        out << line;
    }
    if (f.wrong_side_steps) {
        std::snprintf(line, sizeof line,
                      "  %s: in %lld steps an object pressed on it from inside its skin (it has passed through): use "
                      "smaller steps (dt_ms), or objects thicker than a finger moves in one\n",
                      f.name.c_str(), static_cast<long long>(f.wrong_side_steps));
        out << line;
    }
    if (f.rough_steps) {
        std::snprintf(line, sizeof line,
                      "  %s: %lld steps ended too far from balance to be sent to a thimble, which kept its last "
                      "command: use more iterations (solver.preset)\n",
                      f.name.c_str(), static_cast<long long>(f.rough_steps));
        out << line;
    }
    if (f.beside_share > 0) {
        std::snprintf(line, sizeof line,
                      "  %s: in %.0f %% of its matches something pressed on it from beside the pad (a neighbouring "
                      "finger, a wall): no platform can be there, and none renders it\n",
                      f.name.c_str(), 100 * f.beside_share);
        out << line;
    }
    if (f.extended_steps) {
        std::snprintf(line, sizeof line, "  %s: %lld steps were given more iterations than their preset has\n",
                      f.name.c_str(), static_cast<long long>(f.extended_steps));
        out << line;
    }
    if (f.resets)
        out << "  " << f.name << " diverged and was reset " << f.resets
            << " times: use smaller steps (dt_ms) or softer coupling\n";
}

/// What automatic level of detail did not solve.
void add_left_out(std::ostringstream& out, const DetailCount& d) {
    char line[400];
    if (d.asleep + d.rigid + d.linear + d.coarse > 0) {
        std::snprintf(line, sizeof line,
                      "left out: skin asleep in %.1f %%, rigid in %.1f %%, linear in %.1f %% of the steps of fingers",
                      share_of(d.asleep, d.all), share_of(d.rigid, d.all), share_of(d.linear, d.all));
        out << line;
        if (d.between > 0) {
            std::snprintf(line, sizeof line, ", samples between nodes in %.1f %%", share_of(d.coarse, d.between));
            out << line;
        }
        out << "\n";
    }
}

}  // namespace

std::string to_text(const Summary& s) {
    std::ostringstream out;
    char line[400];
    std::snprintf(line, sizeof line, "%s: %.3g s simulated in %lld steps of %.3g ms\n", s.title.c_str(), s.simulated_s,
                  (long long)s.steps, s.dt_ms);
    out << line;
    std::snprintf(line, sizeof line,
                  "step: median %.0f us, p99 %.0f us, %.1f times real time; mean per system [us]:", s.step_median_us,
                  s.step_p99_us, s.real_time_factor);
    out << line;
    for (const auto& [system, us] : s.system_mean_us) {
        std::snprintf(line, sizeof line, " %s %.1f", system.c_str(), us);
        out << line;
    }
    out << "\n\n";
    std::snprintf(line, sizeof line, "%-10s %9s %9s %9s %7s %6s %6s %10s %9s %9s %8s  %s\n", "finger", "peak N",
                  "mean N", "area mm2", "touch %", "iter", "conv %", "limit viol", "penet um", "match mm", "at lim %",
                  "thimble");
    out << line;
    for (const FingerSummary& f : s.fingers) {
        std::snprintf(line, sizeof line, "%-10s %9.3f %9.3f %9.1f %7.1f %6.1f %6.1f %10.2e %9.3f ", f.name.c_str(),
                      f.peak_force_N, f.mean_force_N, f.peak_area_mm2, 100 * f.touching_share, f.mean_iterations,
                      100 * f.converged_share, f.worst_limit_violation, f.worst_penetration_um);
        out << line;
        if (f.has_device) {
            std::snprintf(line, sizeof line, "%9.3f %8.1f  %s\n", f.matching_rms_mm, 100 * f.constrained_share,
                          f.thimble_mode.c_str());
            out << line;
        } else {
            out << "        -        -  none\n";
        }
        add_remarks(out, f);
    }
    for (const FingerSummary& f : s.fingers)
        if (f.retreats)
            out << "  " << f.name << ": " << f.retreats
                << " times its tracker was silent for so long (tracker_timeout_s) that its thimble was led to rest\n";
    out << to_text(s.bodies);
    if (!s.preset_shares.empty()) {
        out << "presets, as the deadline let them be:";
        for (const auto& [preset, share] : s.preset_shares)
            if (share > 0) {
                std::snprintf(line, sizeof line, " %s %.1f %%", preset.c_str(), 100 * share);
                out << line;
            }
        out << " of the steps; " << s.preset_changes << " changes, " << s.missed_deadlines << " steps took longer\n";
    }
    add_left_out(out, s.detail);
    if (s.filter_delay_ms > 0) {
        std::snprintf(line, sizeof line, "the filter of tracked poses holds them back by %.1f ms on average\n",
                      s.filter_delay_ms);
        out << line;
    }
    if (s.rejected_samples)
        out << s.rejected_samples << " tracker samples were rejected (not finite, or older than the last)\n";
    if (s.missing_samples) out << s.missing_samples << " times a finger had no valid tracker sample\n";
    if (s.slowed_steps)
        out << s.slowed_steps
            << " times a tracked pose jumped and was slowed to coupling.max_speed_m_per_s or max_spin_deg_per_s\n";
    if (!s.warnings.empty()) out << s.warnings.size() << " warnings about the scene (summary.json has them)\n";
    if (s.contact_growths)
        out << s.contact_growths
            << " times a finger needed memory for more objects near it than before (the only steps "
            << "that allocate)\n";
    if (!s.overlap.empty()) out << s.overlap << "\n";
    return out.str();
}

}  // namespace palpate
