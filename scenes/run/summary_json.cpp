#include <nlohmann/json.hpp>

#include "scenes/run/summary.h"

namespace palpate {

namespace {

nlohmann::json finger_json(const FingerSummary& f) {
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
                     {"resets", f.resets},
                     {"wrong_side_steps", f.wrong_side_steps},
                     {"extended_steps", f.extended_steps},
                     {"cut_short_steps", f.cut_short_steps},
                     {"uphill_steps", f.uphill_steps},
                     {"rough_steps", f.rough_steps}};
    if (f.has_device) {
        k["matching_rms_mm"] = f.matching_rms_mm;
        k["constrained_share"] = f.constrained_share;
        k["beside_share"] = f.beside_share;
        k["thimble"] = f.thimble_mode;
        k["led_to_rest"] = f.retreats;
        if (f.commands > 0)
            k["command_age_ms"] = {{"commands", f.commands},
                                   {"median", f.command_age_ms},
                                   {"p99", f.command_age_p99_ms},
                                   {"worst", f.command_age_worst_ms}};
    }
    return k;
}

}  // namespace

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
        j["governor"]["cut_short_steps"] = s.cut_short_steps;
        j["governor"]["changes"] = s.preset_changes;
    }
    for (const auto& [system, us] : s.system_mean_us) j["system_mean_us"][system] = us;
    j["fingers"] = nlohmann::json::array();
    for (const FingerSummary& f : s.fingers) j["fingers"].push_back(finger_json(f));
    for (const SoftSummary& o : s.soft_objects)
        j["soft_objects"].push_back({{"name", o.name},
                                     {"elements", o.elements},
                                     {"force_N", o.force_N},
                                     {"area_mm2", o.area_mm2},
                                     {"dent_mm", o.dent_mm},
                                     {"converged", o.converged},
                                     {"peak_force_N", o.peak_force_N},
                                     {"deepest_dent_mm", o.deepest_dent_mm},
                                     {"converged_share", o.converged_share},
                                     {"entered", o.entered}});
    for (const BodySummary& b : s.bodies) {
        nlohmann::json k{{"name", b.name},
                         {"held_s", b.held_s},
                         {"slip_mm", b.slip_mm},
                         {"drift_mm", b.drift_mm},
                         {"balance", b.balance},
                         {"converged_share", b.converged_share},
                         {"resets", b.resets},
                         {"unsettled_steps", b.unsettled_steps},
                         {"grips", nlohmann::json::array()}};
        if (b.slips_at_weights > 0) k["slips_at_weights"] = b.slips_at_weights;
        if (b.unbalanced_steps > 0) k["unbalanced_steps"] = b.unbalanced_steps;
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
