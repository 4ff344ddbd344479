#include "scenes/run/summary.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <sstream>

#include "scenes/run/hardware.h"

namespace palpate {

namespace {

double quantile(std::vector<double> v, double q) {
    if (v.empty()) return 0;
    const auto k = std::size_t(q * double(v.size() - 1) + 0.5);
    std::nth_element(v.begin(), v.begin() + long(k), v.end());
    return v[k];
}

double mean(const std::vector<double>& v) {
    double sum = 0;
    for (double x : v) sum += x;
    return v.empty() ? 0 : sum / double(v.size());
}

double largest(const std::vector<double>& v) { return v.empty() ? 0 : *std::max_element(v.begin(), v.end()); }

/// Of the steps that are settled; where none is, of all.
std::vector<double> settled_values(const std::vector<double>& values, const std::vector<char>& settled) {
    std::vector<double> out;
    for (std::size_t k = 0; k < values.size(); ++k)
        if (settled[k]) out.push_back(values[k]);
    return out.empty() ? values : out;
}

FingerSummary summarise_finger(const Simulation& s, std::size_t i) {
    const Series& series = s.finger_series[i];
    FingerSummary f;
    f.name = s.scene.spec.fingers[i].name;
    const auto settled = settled_steps(series);
    const auto all_forces = series.column("contact_force_N"), force = settled_values(all_forces, settled);
    f.peak_force_N = largest(force);
    for (std::size_t k = 0; k < settled.size(); ++k)
        if (!settled[k]) ++f.unsettled_steps, f.unsettled_peak_N = std::max(f.unsettled_peak_N, all_forces[k]);
    std::vector<double> touching;
    for (double x : force)
        if (x > 0) touching.push_back(x);
    f.mean_force_N = mean(touching);
    f.touching_share = force.empty() ? 0 : double(touching.size()) / double(force.size());
    f.peak_area_mm2 = largest(settled_values(series.column("contact_area_mm2"), settled));
    f.worst_limit_violation = largest(series.column("limit_violation"));
    f.worst_penetration_um = largest(series.column("penetration_um"));
    f.fixed_penetration_um = largest(series.column("fixed_penetration_um"));
    f.mean_iterations = mean(series.column("newton_iterations"));
    f.converged_share = mean(series.column("converged"));
    f.resets = int(s.finger_resets[i]);
    for (std::size_t t = 0; t < s.world.matchings.size(); ++t) {
        const Matching& m = s.world.matchings[t];
        if (!(m.finger == s.fingers[i])) continue;
        f.has_device = true;
        f.constrained_share = m.contact_solves ? double(m.constrained_solves) / double(m.contact_solves) : 0;
        const ThimbleStatus& status = s.loops[t]->status;
        f.thimble_mode = status.faults      ? "fault"
                         : status.stale > 0 ? std::to_string(status.stale) + " times without a valid command"
                                            : "ok";
        f.retreats = s.world.device_links[t].retreats;
        const auto rms = series.column("matching_rms_mm"), matched = series.column("contact_matched");
        double sum = 0, count = 0;
        for (std::size_t k = 0; k < rms.size(); ++k)
            if (matched[k] > 0) sum += rms[k], ++count;
        f.matching_rms_mm = count > 0 ? sum / count : 0;
        const CommandAge age = command_age(s, t);
        f.commands = age.count;
        f.command_age_ms = age.median_ms, f.command_age_p99_ms = age.p99_ms, f.command_age_worst_ms = age.worst_ms;
    }
    return f;
}

/// In percent.
double share_of(std::int64_t part, std::int64_t all) { return all > 0 ? 100.0 * double(part) / double(all) : 0; }

}  // namespace

std::vector<char> settled_steps(const Series& finger) {
    const auto converged = finger.column("converged"), residual = finger.column("residual_N"),
               coupling = finger.column("coupling_force_N");
    std::vector<char> out;
    for (std::size_t k = 0; k < converged.size(); ++k)
        out.push_back(converged[k] > 0 || residual[k] <= std::max(1e-3, settled_share * coupling[k]));
    return out;
}

Summary summarise(const Simulation& s) {
    Summary out;
    out.title = s.scene.title;
    out.simulated_s = s.world.time;
    out.dt_ms = 1e3 * s.world.solver.dt;
    out.steps = s.world.step;
    const auto total = s.step_series.column("total_us");
    out.step_median_us = quantile(total, 0.5);
    out.step_p99_us = quantile(total, 0.99);
    out.real_time_factor = mean(total) > 0 ? 1e6 * s.world.solver.dt / mean(total) : 0;
    for (std::size_t c = 1; c + 1 < s.step_series.columns.size(); ++c) {
        const std::string& column = s.step_series.columns[c];
        out.system_mean_us.emplace_back(column.substr(0, column.size() - 3), mean(s.step_series.column(column)));
    }
    out.skin_memory_MB = double(skin_memory_bytes(s.world)) / 1e6;
    out.contact_growths = s.world.contact_growths;
    if (const ObjectOverlap& o = s.world.body_solve.deepest; o.depth > 0) {
        std::ostringstream text;
        text << "\"" << s.world.shapes[o.a].name << "\" was up to " << 1e3 * o.depth << " mm inside \""
             << s.world.shapes[o.b].name << "\" (at " << o.time << " s): such overlaps are undone at "
             << 1e3 * s.world.solver.recovery_speed << " mm/s";
        out.overlap = text.str();
    }
    out.detail = s.detail;
    if (s.governor) {
        for (std::size_t p = 0; p < preset_names().size(); ++p)
            out.preset_shares.emplace_back(preset_names()[p],
                                           double(s.governor->steps[p]) / double(std::max<std::int64_t>(1, out.steps)));
        out.missed_deadlines = s.governor->missed;
        out.preset_changes = s.governor->changes;
    }
    for (const TrackerPose& t : s.world.tracker_poses) {
        out.rejected_samples += t.not_finite + t.backward;
        out.missing_samples += t.missing;
    }
    double delay = 0, samples = 0;
    for (const PoseFilter& f : s.world.pose_filters) delay += f.delay_sum, samples += double(f.samples);
    out.filter_delay_ms = samples > 0 ? 1e3 * delay / samples : 0;
    for (const Coupling& c : s.world.couplings) out.slowed_steps += c.slowed;
    for (std::size_t i = 0; i < s.fingers.size(); ++i) out.fingers.push_back(summarise_finger(s, i));
    out.bodies = summarise_bodies(s);
    out.warnings = s.scene.warnings;
    return out;
}

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

nlohmann::json to_json(const Summary& s) {
    nlohmann::json j{{"title", s.title},
                     {"simulated_s", s.simulated_s},
                     {"dt_ms", s.dt_ms},
                     {"steps", s.steps},
                     {"step_median_us", s.step_median_us},
                     {"step_p99_us", s.step_p99_us},
                     {"real_time_factor", s.real_time_factor},
                     {"skin_memory_MB", s.skin_memory_MB},
                     {"filter_delay_ms", s.filter_delay_ms},
                     {"rejected_samples", s.rejected_samples},
                     {"missing_samples", s.missing_samples},
                     {"slowed_steps", s.slowed_steps},
                     {"contact_growths", s.contact_growths},
                     {"overlap", s.overlap},
                     {"warnings", s.warnings}};
    if (s.detail.all > 0)
        j["left_out"] = {{"asleep", 0.01 * share_of(s.detail.asleep, s.detail.all)},
                         {"rigid", 0.01 * share_of(s.detail.rigid, s.detail.all)},
                         {"linear", 0.01 * share_of(s.detail.linear, s.detail.all)},
                         {"between_nodes", 0.01 * share_of(s.detail.coarse, s.detail.between)}};
    for (const auto& [preset, share] : s.preset_shares) j["governor"]["presets"][preset] = share;
    if (!s.preset_shares.empty()) {
        j["governor"]["missed_deadlines"] = s.missed_deadlines;
        j["governor"]["changes"] = s.preset_changes;
    }
    for (const auto& [system, us] : s.system_mean_us) j["system_mean_us"][system] = us;
    j["fingers"] = nlohmann::json::array();
    for (const FingerSummary& f : s.fingers) {
        nlohmann::json k{{"name", f.name},
                         {"peak_force_N", f.peak_force_N},
                         {"mean_force_N", f.mean_force_N},
                         {"peak_area_mm2", f.peak_area_mm2},
                         {"touching_share", f.touching_share},
                         {"worst_limit_violation", f.worst_limit_violation},
                         {"worst_penetration_um", f.worst_penetration_um},
                         {"fixed_penetration_um", f.fixed_penetration_um},
                         {"unsettled_steps", f.unsettled_steps},
                         {"unsettled_peak_N", f.unsettled_peak_N},
                         {"mean_iterations", f.mean_iterations},
                         {"converged_share", f.converged_share},
                         {"resets", f.resets}};
        if (f.has_device) {
            k["matching_rms_mm"] = f.matching_rms_mm;
            k["constrained_share"] = f.constrained_share;
            k["thimble"] = f.thimble_mode;
            k["led_to_rest"] = f.retreats;
            if (f.commands > 0)
                k["command_age_ms"] = {{"commands", f.commands},
                                       {"median", f.command_age_ms},
                                       {"p99", f.command_age_p99_ms},
                                       {"worst", f.command_age_worst_ms}};
        }
        j["fingers"].push_back(k);
    }
    for (const BodySummary& b : s.bodies) {
        nlohmann::json k{{"name", b.name},       {"held_s", b.held_s},
                         {"slip_mm", b.slip_mm}, {"drift_mm", b.drift_mm},
                         {"balance", b.balance}, {"converged_share", b.converged_share},
                         {"resets", b.resets},   {"grips", nlohmann::json::array()}};
        if (b.dropped_at_s >= 0) k["dropped_at_s"] = b.dropped_at_s;
        for (const GripSummary& g : b.grips)
            k["grips"].push_back({{"finger", g.finger},
                                  {"mean_N", g.mean_N},
                                  {"friction_use", g.friction_use},
                                  {"slip_mm", g.slip_mm},
                                  {"reserve_weakest_N", g.reserve.weakest_N},
                                  {"reserve_weight_N", g.reserve.load_N},
                                  {"reserve_twist_N_mm", g.reserve.twist_N_mm}});
        j["bodies"].push_back(k);
    }
    return j;
}

}  // namespace palpate
