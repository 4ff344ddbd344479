#include "scenes/trackers/frame_order.h"

#include <algorithm>
#include <utility>

namespace palpate {

namespace {

constexpr std::size_t remembered_senders = 8;
/// A clock that goes back by so much was started anew, or is another one; less is a frame that was overtaken [s].
constexpr double other_clock_from = 1;

double seconds(DeviceClock::duration d) { return std::chrono::duration<double>(d).count(); }

}  // namespace

/// Whether a time is about where this clock must be now.
bool FrameOrder::TrackerClock::goes_on_with(double next, Clock::time_point now) const {
    return frames > 0 && now - arrived <= silence && next >= time &&
           next <= time + seconds(now - arrived) + other_clock_from;
}

/// Counts a sender's messages, this one included, while it is not silent.
int FrameOrder::messages_of(const std::string& name, Clock::time_point now) {
    auto it = std::find_if(senders_.begin(), senders_.end(), [&](const Sender& s) { return s.name == name; });
    if (it == senders_.end()) {
        if (senders_.size() == remembered_senders)  // the one that was silent longest
            it = std::min_element(senders_.begin(), senders_.end(),
                                  [](const Sender& a, const Sender& b) { return a.heard < b.heard; });
        else
            it = senders_.emplace(senders_.end());
        *it = {name, 0, now};
    }
    if (now - it->heard > silence) it->messages = 0;
    it->heard = now;
    return it->messages = std::min(it->messages + 1, settled);
}

FrameVerdict FrameOrder::judge(Clock::time_point now, std::optional<double> time, const std::string& sender) {
    if (!sender.empty()) {
        messages_of(sender, now);
        const auto in_use = std::find_if(senders_.begin(), senders_.end(),
                                         [&](const Sender& s) { return s.name == sender_ && sender_ != sender; });
        if (in_use != senders_.end() && in_use->messages >= settled && now - taken_ <= silence)
            return FrameVerdict::other_sender;
    }
    const FrameVerdict verdict = time ? by_clock(*time, now) : FrameVerdict::taken;
    if (verdict != FrameVerdict::taken) return verdict;
    taken_ = now;
    if (sender_ != sender) sender_ = sender;
    return verdict;
}

void FrameOrder::forget(const std::string& sender) {
    std::erase_if(senders_, [&](const Sender& s) { return s.name == sender; });
}

FrameVerdict FrameOrder::by_clock(double time, Clock::time_point now) {
    const double ahead = time - clock_.time;
    if (clock_.frames > 0) {
        if (ahead == 0) return FrameVerdict::standing;
        if (ahead < 0 && ahead > -other_clock_from) return FrameVerdict::overtaken;
        if (ahead < 0 || ahead > seconds(now - clock_.arrived) + other_clock_from) return by_another_clock(time, now);
    }
    clock_ = {time, now, clock_.frames + 1};
    return FrameVerdict::taken;
}

/// Of a tracker that was started anew nothing more comes by its old clock. Where both go on, the one that more frames
/// went by stays in use.
FrameVerdict FrameOrder::by_another_clock(double time, Clock::time_point now) {
    for (TrackerClock& other : others_) {
        if (!other.goes_on_with(time, now)) continue;
        const bool stands = time == other.time, stays = now - clock_.arrived <= silence && other.frames < clock_.frames;
        if (stands || stays) {
            other.time = time, other.arrived = now;  // it goes on, and is known again
            return stands ? FrameVerdict::standing : FrameVerdict::other_clock;
        }
        std::swap(other, clock_);
        clock_ = {time, now, clock_.frames + 1};
        return FrameVerdict::taken;
    }
    *std::min_element(others_.begin(), others_.end(),
                      [](const TrackerClock& a, const TrackerClock& b) { return a.arrived < b.arrived; }) = clock_;
    clock_ = {time, now, 1};
    return FrameVerdict::taken;
}

}  // namespace palpate
