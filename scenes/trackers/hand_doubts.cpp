#include "scenes/trackers/hand_doubts.h"

#include <algorithm>
#include <cmath>
#include <sstream>

namespace palpate {

namespace {

constexpr std::int64_t enough_frames = 30;
constexpr double usual_interval = 0.015;  ///< of trackers: 4 to 50 ms [s]

std::string count(std::int64_t n, const char* what) { return std::to_string(n) + " " + what + (n == 1 ? "" : "s"); }

/// What a time that is so many times too long is likely counted in.
std::string likely_unit(double factor) {
    const char* names[] = {"milliseconds", "microseconds", "nanoseconds"};
    const double thousands = std::log10(factor) / 3;
    const auto power = std::lround(thousands);
    const bool named = power >= 1 && power <= 3 && std::abs(thousands - double(power)) < 0.3;
    return (named ? std::string(": \"t\" looks like ") + names[power - 1] : "") + "; seconds are expected";
}

std::string about_units(const HandCounts& c) {
    const double factor = c.fast_s / std::max(c.fast_lasted_s, 1e-9);
    return "the tracker's time runs " + std::to_string(std::llround(factor)) + " times as fast as time here" +
           likely_unit(factor);
}

std::string about_standstill(const HandCounts& c) {
    return "time stands still: messages went on with the same \"t\" for a quarter of a second or more, " +
           count(c.standstills, "time") + " (" + count(c.standing, "frame") +
           " in all), which is no hand that is seen; a sender without a clock leaves \"t\" out";
}

std::string about_senders(const HandCounts& c) {
    const std::string in_use = c.sender.empty() ? "the first" : c.sender;
    std::string text =
        std::string(c.other_sender ? "two senders at once: " : "two clocks at once: ") + in_use + " is listened to, ";
    if (c.other_sender) text += count(c.other_sender, "frame") + " of " + c.refused_sender;
    if (c.other_clock)
        text += (c.other_sender ? " and " : "") + count(c.other_clock, "frame") + " by another clock" +
                (c.refused_sender.empty() || c.other_sender ? "" : " of " + c.refused_sender);
    return text + " were refused; stop one, or give it another port";
}

}  // namespace

std::vector<HandDoubt> hand_doubts(const HandMailbox& mailbox) {
    const HandCounts c = mailbox.counts();
    std::vector<HandDoubt> doubts;
    if (c.standstills) doubts.push_back({"standstill", about_standstill(c)});
    if (c.other_sender || c.other_clock) doubts.push_back({"senders", about_senders(c)});
    const std::int64_t frames = c.frames[0] + c.frames[1];
    if (c.fast >= enough_frames && 2 * c.fast > frames) doubts.push_back({"units", about_units(c)});
    const BoneTally bones = mailbox.bones();
    if (bones.frames() >= enough_frames)
        if (std::string problem = bone_problem(bones); !problem.empty())
            doubts.push_back({"bones", std::move(problem)});
    return doubts;
}

std::string recorded_time_problem(const HandRecording& recording) {
    std::vector<double> intervals;
    for (std::size_t k = 1; k < recording.frames.size(); ++k)
        intervals.push_back(recording.frames[k].time - recording.frames[k - 1].time);
    if (intervals.empty()) return "";
    const auto middle = intervals.begin() + std::ptrdiff_t(intervals.size() / 2);
    std::nth_element(intervals.begin(), middle, intervals.end());
    if (*middle < 1) return "";
    std::ostringstream apart;
    apart << *middle;
    return "frames are " + apart.str() + " s apart (median)" + likely_unit(*middle / usual_interval) +
           ", and a hand is not seen in gaps of more than 0.1 s";
}

std::vector<std::string> DoubtTeller::news(const HandMailbox& mailbox) {
    std::vector<std::string> texts;
    const double now = device_clock();
    if (now < next_) return texts;
    next_ = now + 1;
    for (HandDoubt& doubt : hand_doubts(mailbox)) {
        if (std::find(told_.begin(), told_.end(), doubt.key) != told_.end()) continue;
        told_.emplace_back(doubt.key);
        texts.push_back(std::move(doubt.text));
    }
    return texts;
}

}  // namespace palpate
