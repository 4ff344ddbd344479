// A summary in words, for a terminal: what each finger felt, how well it was solved, and what a person should know
// before he believes the figures. summary.json has every figure of every finger.

#include <algorithm>
#include <functional>

#include "scenes/run/hardware.h"
#include "scenes/run/summary.h"
#include "scenes/run/wrapped.h"

namespace palpate {

namespace {

using Fingers = std::vector<const FingerSummary*>;

std::string names_of(const Fingers& some, std::size_t all) {
    if (some.size() == all && all > 2) return "all fingers";
    std::string out;
    for (const FingerSummary* f : some) out += (out.empty() ? "" : ", ") + f->name;
    return out;
}

/// One sentence for all fingers of which it is true; `#` in it stands for the worst value.
std::string remark(const Summary& s, const std::function<double(const FingerSummary&)>& value, double beyond,
                   const char* number, const std::string& sentence) {
    Fingers some;
    double worst = 0;
    for (const FingerSummary& f : s.fingers)
        if (value(f) > beyond) some.push_back(&f), worst = std::max(worst, value(f));
    if (some.empty()) return "";
    std::string text = sentence;
    const std::size_t at = text.find('#');
    text.replace(at, 1, (some.size() > 1 ? "up to " : "") + written(number, worst));
    return wrapped(names_of(some, s.fingers.size()) + ": " + text, "  ");
}

std::string remarks(const Summary& s) {
    using F = const FingerSummary&;
    std::string out;
    for (F f : s.fingers)
        if (f.thimble_mode.size() > 14) out += wrapped(f.name + ": its thimble was " + f.thimble_mode, "  ");
    for (F f : s.fingers)
        if (1e-3 * f.command_age_p99_ms > longest_command_age)
            out += wrapped(written("%s feels commands late: %.1f ms at the wire (p99; median %.1f, longest %.1f)",
                                   f.name.c_str(), f.command_age_p99_ms, f.command_age_ms, f.command_age_worst_ms),
                           "  ");
    for (F f : s.fingers)
        if (f.unsettled_steps)
            out += wrapped(written("%s: %lld steps ended with more than %.0f %% of its force unbalanced; the peak and "
                                   "mean leave them out (they reported up to %.3f N)",
                                   f.name.c_str(), static_cast<long long>(f.unsettled_steps), 100 * settled_share,
                                   f.unsettled_peak_N),
                           "  ");
    out += remark(
        s, [](F f) { return f.fixed_penetration_um > 10 ? 1e-3 * f.fixed_penetration_um : 0; }, 0, "%.3f",
        "skin that rides on its bone (nail, back, rim of the cut) was # mm inside an object: it does not touch, and "
        "nothing pushed it out");
    out += remark(
        s, [](F f) { return double(f.wrong_side_steps); }, 0, "%.0f",
        "in # steps an object pressed on it from inside its skin, or its skin has leapt through one (it has passed "
        "through): use smaller steps (dt_ms), "
        "objects thicker than a finger moves in one, or closer samples (solver.sample_refinement)");
    out += remark(
        s, [](F f) { return double(f.rough_steps); }, 0, "%.0f",
        "# steps ended too far from balance to be sent to a thimble, which kept its last command: use more iterations "
        "(solver.preset)");
    out += remark(
        s, [](F f) { return 100 * f.beside_share; }, 0, "%.0f",
        "in # % of its matches something pressed on it from beside the pad (a neighbouring finger, a wall): no "
        "platform can be there, and none renders it");
    out += remark(
        s, [](F f) { return double(f.extended_steps); }, 0, "%.0f",
        "# steps were given more iterations than their preset has");
    out += remark(
        s, [](F f) { return double(f.uphill_steps); }, 0, "%.0f",
        "# times a Newton step led uphill, however short, and was taken back");
    out += remark(
        s, [](F f) { return double(f.cut_short_steps); }, 0, "%.0f",
        "# steps were cut short by the deadline before they had converged: allow more time (solver.deadline_ms), or "
        "ask for less (solver.preset, elements)");
    out += remark(
        s, [](F f) { return double(f.resets); }, 0, "%.0f",
        "diverged and was reset # times: use smaller steps (dt_ms) or softer coupling");
    out += remark(
        s, [](F f) { return double(f.retreats); }, 0, "%.0f",
        "# times its tracker was silent for so long (tracker_timeout_s) that its thimble was led to rest");
    return out;
}

std::string finger_table(const Summary& s) {
    std::size_t widest = 6;
    bool thimbles = false;
    for (const FingerSummary& f : s.fingers) widest = std::max(widest, f.name.size()), thimbles |= f.has_device;
    const int name = int(std::min<std::size_t>(widest, 24));
    std::string out = written("%-*s  %8s %8s %8s %7s", name, "", "peak", "mean", "area", "touch");
    if (thimbles) out += written(" %8s %9s  %s", "match", "at limit", "thimble");
    out += written("\n%-*s  %8s %8s %8s %7s", name, "finger", "N", "N", "mm2", "%");
    if (thimbles) out += written(" %8s %9s", "mm", "%");
    out += "\n";
    for (const FingerSummary& f : s.fingers) {
        out += written("%-*s  %8.3f %8.3f %8.1f %7.1f", name, f.name.c_str(), f.peak_force_N, f.mean_force_N,
                       f.peak_area_mm2, 100 * f.touching_share);
        if (f.has_device)
            out += written(" %8.3f %9.1f  %s", f.matching_rms_mm, 100 * f.constrained_share,
                           f.thimble_mode.size() > 14 ? "see below" : f.thimble_mode.c_str());
        else if (thimbles)
            out += written(" %8s %9s  none", "-", "-");
        out += "\n";
    }
    return out;
}

/// How well the fingers were solved: means over them, and the worst of them.
std::string solver_sentence(const Summary& s) {
    if (s.fingers.empty()) return "";
    double iterations = 0, converged = 0;
    const FingerSummary *least = &s.fingers[0], *limit = least, *deepest = least;
    for (const FingerSummary& f : s.fingers) {
        iterations += f.mean_iterations / double(s.fingers.size());
        converged += f.converged_share / double(s.fingers.size());
        if (f.converged_share < least->converged_share) least = &f;
        if (f.worst_limit_violation > limit->worst_limit_violation) limit = &f;
        if (f.worst_penetration_um > deepest->worst_penetration_um) deepest = &f;
    }
    std::string out =
        written("solved: %.1f iterations a step, %.1f %% of the steps converged", iterations, 100 * converged);
    if (least->converged_share < converged - 0.01)
        out += written(" (of %s %.1f %%)", least->name.c_str(), 100 * least->converged_share);
    if (s.unbalanced_share > 0 && converged < 0.99)
        out += written(", as iterations are spared where %.2g %% or less of the force is unbalanced",
                       100 * s.unbalanced_share);
    out += written("; strain limits exceeded by at most %.1e", limit->worst_limit_violation);
    if (limit->worst_limit_violation > 0 && s.fingers.size() > 1) out += " (" + limit->name + ")";
    out += written(", skin at most %.3f um inside an object", deepest->worst_penetration_um);
    if (deepest->worst_penetration_um > 0 && s.fingers.size() > 1) out += " (" + deepest->name + ")";
    return wrapped(out);
}

std::string time_text(double us) { return us < 1000 ? written("%.0f us", us) : written("%.3g ms", 1e-3 * us); }

/// How long steps took, and the parts that took most of it.
std::string speed_sentence(const Summary& s) {
    auto parts = s.system_mean_us;
    std::stable_sort(parts.begin(), parts.end(), [](const auto& a, const auto& b) { return a.second > b.second; });
    std::string out = written("%.1f times real time: a step took ", s.real_time_factor) + time_text(s.step_median_us) +
                      " (median), 99 % of them at most " + time_text(s.step_p99_us) + "; most of it";
    for (std::size_t k = 0; k < std::min<std::size_t>(3, parts.size()); ++k)
        out += (k > 0 ? ", " : " ") + parts[k].first + " " + time_text(parts[k].second);
    return wrapped(out);
}

/// What automatic level of detail did not solve.
std::string left_out(const DetailCount& d) {
    if (d.asleep + d.rigid + d.linear + d.coarse == 0) return "";
    std::string out =
        written("left out: skin asleep in %.1f %%, rigid in %.1f %%, linear in %.1f %% of the steps of fingers",
                share_of(d.asleep, d.all), share_of(d.rigid, d.all), share_of(d.linear, d.all));
    if (d.between > 0) out += written(", samples between nodes in %.1f %%", share_of(d.coarse, d.between));
    return wrapped(out);
}

std::string presets(const Summary& s) {
    if (s.preset_shares.empty()) return "";
    std::string out = "presets, as the deadline let them be:";
    for (const auto& [preset, share] : s.preset_shares)
        if (share > 0) out += written(" %s %.1f %%", preset.c_str(), 100 * share);
    return wrapped(out + written(" of the steps; %lld changes, %lld steps cut short, %lld took longer",
                                 static_cast<long long>(s.preset_changes), static_cast<long long>(s.cut_short_steps),
                                 static_cast<long long>(s.missed_deadlines)));
}

std::string soft_objects(const Summary& s) {
    std::string out;
    for (const SoftSummary& o : s.soft_objects)
        out += wrapped(
            written("soft object %s (%d elements): pressed with up to %.3f N, dented by up to %.2f mm, %.1f %% of "
                    "its steps converged; at the end %.3f N on %.0f mm2, %.2f mm%s%s",
                    o.name.c_str(), o.elements, o.peak_force_N, o.deepest_dent_mm, 100 * o.converged_share, o.force_N,
                    o.area_mm2, o.dent_mm, o.converged ? "" : ", not converged", o.entered.c_str()));
    return out;
}

/// Of the run as a whole.
std::string run_remarks(const Summary& s) {
    std::string out;
    auto count = [&](std::int64_t times, const char* sentence) {
        if (times) out += wrapped(written("%lld %s", static_cast<long long>(times), sentence));
    };
    if (s.filter_delay_ms > 0)
        out += wrapped(written("the filter of tracked poses holds them back by %.1f ms on average", s.filter_delay_ms));
    count(s.rejected_samples, "tracker samples were rejected (not finite, or older than the last)");
    count(s.missing_samples, "times a finger had no valid tracker sample");
    count(s.slowed_steps,
          "times a tracked pose jumped and was slowed to coupling.max_speed_m_per_s or max_spin_deg_per_s");
    count(std::int64_t(s.warnings.size()), "warnings about the scene or the hand (summary.json has them)");
    count(s.contact_growths,
          "times a finger needed memory for more objects near it than before (the only steps that allocate)");
    if (!s.overlap.empty()) out += wrapped(s.overlap);
    return out;
}

std::string legend(const Summary& s) {
    std::string out = "peak, mean: contact force, mean while it touches; area: the largest; touch: share of the steps";
    if (std::any_of(s.fingers.begin(), s.fingers.end(), [](const FingerSummary& f) { return f.has_device; }))
        out +=
            "; match: between the platform and what it should touch (rms); at limit: share of matches at the edge of "
            "the workspace";
    return wrapped(out);
}

}  // namespace

std::string to_text(const Summary& s) {
    std::string out = wrapped(written("%s: %.3g s in %lld steps of %.3g ms", s.title.c_str(), s.simulated_s,
                                      static_cast<long long>(s.steps), s.dt_ms));
    out += speed_sentence(s) + "\n" + finger_table(s) + legend(s) + "\n" + solver_sentence(s) + remarks(s);
    return out + to_text(s.bodies) + soft_objects(s) + presets(s) + left_out(s.detail) + run_remarks(s);
}

}  // namespace palpate
