#include "scenes/run/summary.h"

#include <algorithm>
#include <cmath>

#include "meshes/plain_numbers.h"
#include "scenes/run/hardware.h"
#include "scenes/run/soft_series.h"
#include "scenes/trackers/hand_doubts.h"

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
    f.resets = int(s.finger_counts[i].resets);
    f.wrong_side_steps = s.finger_counts[i].wrong_side_steps;
    f.extended_steps = s.finger_counts[i].extended_steps;
    f.cut_short_steps = s.finger_counts[i].cut_short_steps;
    f.uphill_steps = s.finger_counts[i].uphill_steps;
    f.rough_steps = s.world.contact_surfaces.find(s.fingers[i])->rough_steps;
    for (std::size_t t = 0; t < s.world.matchings.size(); ++t) {
        const Matching& m = s.world.matchings[t];
        if (!(m.finger == s.fingers[i])) continue;
        f.has_device = true;
        f.constrained_share = m.contact_solves ? double(m.constrained_solves) / double(m.contact_solves) : 0;
        f.beside_share = m.solves ? double(m.beside_solves) / double(m.solves) : 0;
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

SoftSummary summarise_soft(const Simulation& s, std::size_t k) {
    const SoftObject& o = s.world.soft.all[k];
    SoftSummary out;
    out.name = o.skin.name;
    out.elements = int(o.skin.mesh.tets.size());
    out.force_N = o.surface.normal_force;
    out.area_mm2 = 1e6 * o.surface.touching_area;
    out.converged = has_converged(s.world, o);
    out.dent_mm = 1e3 * deepest_dent(s.world, o);
    if (o.entered_steps > 0) {
        PlainText text;
        text << "; in " << o.entered_steps << " steps, first at " << o.entered_at
             << " s, something was in its tissue that passed between its samples, first \""
             << s.world.shapes[std::size_t(o.entered_by)].name
             << "\": what presses it is less than it should be; more elements, or solver.sample_refinement, bring "
                "samples nearer";
        out.entered = text.str();
    }
    const Series& series = s.soft_series[k];
    for (const double force : series.column("contact_force_N")) out.peak_force_N = std::max(out.peak_force_N, force);
    for (const double dent : series.column("dent_mm")) out.deepest_dent_mm = std::max(out.deepest_dent_mm, dent);
    if (series.rows() > 0) out.converged_share = mean(series.column("converged"));
    return out;
}

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
    out.unbalanced_share = s.world.solver.unbalanced_share;
    out.real_time_factor = mean(total) > 0 ? 1e6 * s.world.solver.dt / mean(total) : 0;
    for (std::size_t c = 1; c + 1 < s.step_series.columns.size(); ++c) {
        const std::string& column = s.step_series.columns[c];
        out.system_mean_us.emplace_back(column.substr(0, column.size() - 3), mean(s.step_series.column(column)));
    }
    out.skin_memory_MB = double(skin_memory_bytes(s.world)) / 1e6;
    out.contact_growths = s.world.contact_growths;
    if (const ObjectOverlap& o = s.world.body_solve.deepest; o.depth > 0) {
        PlainText text;
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
        out.cut_short_steps = s.governor->cut_short;
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
    for (std::size_t k = 0; k < s.world.soft.all.size(); ++k) out.soft_objects.push_back(summarise_soft(s, k));
    out.warnings = s.scene.warnings;
    if (s.live)
        for (const HandDoubt& doubt : hand_doubts(s.live->mailbox)) out.warnings.push_back("live hand: " + doubt.text);
    return out;
}

}  // namespace palpate
