#include "scenes/trackers/hand_mailbox.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "scenes/web/bounded_json.h"

namespace palpate {

namespace {
constexpr std::size_t remembered_arrivals = 1024;
constexpr auto stale = std::chrono::milliseconds(250);
constexpr auto timing_window = std::chrono::seconds(5);

double quantile(std::vector<double>& values, double share) {
    if (values.empty()) return 0;
    const auto at = values.begin() + std::ptrdiff_t(share * double(values.size() - 1));
    std::nth_element(values.begin(), at, values.end());
    return *at;
}
}  // namespace

void HandMailbox::take(int hand, const HandFrame& frame, std::optional<double> time, const std::string& sender) {
    {
        const std::lock_guard lock(mutex_);
        Hand& h = hands_[std::size_t(hand)];
        const auto now = Clock::now();
        if (!welcome(h, frame, time, sender, now)) return;
        if (time) count_fast(h, *time, now);
        h.frame = frame, h.arrived = now, h.time = time, h.stands = false;
        if (frame.valid) ++counts_.frames[std::size_t(hand)], bones_.add(frame.bones);
        // Both hands of one frame are one arrival.
        if (arrivals_.empty() || !time || arrivals_.back().time != time) arrivals_.push_back({now, time});
        if (arrivals_.size() > remembered_arrivals) arrivals_.pop_front();
    }
    if (!listener_ || !frame.valid) return;
    HandFrame told = frame;
    told.own_time = time;
    listener_(hand, told);
}

bool HandMailbox::welcome(Hand& h, const HandFrame& frame, std::optional<double> time, const std::string& sender,
                          Clock::time_point now) {
    switch (h.order.judge(now, time, sender)) {
        case FrameVerdict::taken:
            if (counts_.sender != sender) counts_.sender = sender;
            return true;
        case FrameVerdict::overtaken:
            ++counts_.backward;
            return false;
        case FrameVerdict::standing:
            ++counts_.standing;
            h.stood_at = now;
            // What it saw at that time is old; that it sees nothing is believed at any time.
            h.frame.valid = h.frame.valid && frame.valid;
            if (h.frame.valid && !h.stands && now - h.arrived >= stale) h.stands = true, ++counts_.standstills;
            return false;
        case FrameVerdict::other_sender:
            ++counts_.other_sender;
            counts_.refused_sender = sender;
            return false;
        case FrameVerdict::other_clock:
            ++counts_.other_clock;
            if (sender != counts_.sender) counts_.refused_sender = sender;
            return false;
    }
    return false;
}

/// Trackers give frames a few hundredths of a second apart. Where their times are a quarter of a second apart or more,
/// and that did not take a thirtieth of it, they are no seconds.
void HandMailbox::count_fast(const Hand& h, double time, Clock::time_point now) {
    if (!h.time) return;
    const double on = time - *h.time, lasted = std::chrono::duration<double>(now - h.arrived).count();
    if (on < 0.25 || lasted > on / 30) return;
    ++counts_.fast, counts_.fast_s += on, counts_.fast_lasted_s += lasted;
}

void HandMailbox::forget(const std::string& sender) {
    const std::lock_guard lock(mutex_);
    for (Hand& hand : hands_) hand.order.forget(sender);
}

void HandMailbox::count_malformed(std::string problem) {
    const std::lock_guard lock(mutex_);
    ++counts_.malformed;
    counts_.last_problem = std::move(problem);
}

void HandMailbox::count_lost(std::int64_t frames) {
    const std::lock_guard lock(mutex_);
    counts_.lost += frames;
}

void HandMailbox::count_connection() {
    const std::lock_guard lock(mutex_);
    ++counts_.connections;
}

HandCounts HandMailbox::counts() const {
    const std::lock_guard lock(mutex_);
    return counts_;
}

HandTiming HandMailbox::timing() const {
    std::vector<Arrival> arrivals;
    bool seconds_by_appearance;
    {
        const std::lock_guard lock(mutex_);
        seconds_by_appearance = 2 * counts_.fast <= counts_.frames[0] + counts_.frames[1];
        const auto oldest = Clock::now() - timing_window;
        for (const Arrival& a : arrivals_)
            if (a.at > oldest) arrivals.push_back(a);
    }
    HandTiming t;
    if (arrivals.size() < 2) return t;
    auto seconds = [](Clock::duration d) { return std::chrono::duration<double>(d).count(); };
    std::vector<double> intervals, delays;
    for (std::size_t k = 0; k < arrivals.size(); ++k) {
        if (k > 0) intervals.push_back(1e3 * seconds(arrivals[k].at - arrivals[k - 1].at));
        if (arrivals[k].time) delays.push_back(1e3 * (seconds(arrivals[k].at - arrivals[0].at) - *arrivals[k].time));
    }
    t.rate_Hz = double(intervals.size()) / seconds(arrivals.back().at - arrivals.front().at);
    t.interval_ms = quantile(intervals, 0.5), t.interval_p95_ms = quantile(intervals, 0.95);
    t.has_clock = delays.size() == arrivals.size() && seconds_by_appearance;
    if (t.has_clock) {
        // A frame by another clock, before it was known for that, or of a tracker that was started anew since.
        const double newest = delays.back();
        std::erase_if(delays, [&](double d) { return std::abs(d - newest) > 1000; });
        // The clocks' offset is that of the frame that came fastest.
        const double offset = *std::min_element(delays.begin(), delays.end());
        t.delay_ms = quantile(delays, 0.5) - offset, t.delay_p95_ms = quantile(delays, 0.95) - offset;
    }
    return t;
}

BoneTally HandMailbox::bones() const {
    const std::lock_guard lock(mutex_);
    return bones_;
}

bool HandMailbox::stands_still(int hand) const {
    const std::lock_guard lock(mutex_);
    const Hand& h = hands_[std::size_t(hand)];
    const auto now = Clock::now();
    return h.stands && now - h.stood_at < stale;
}

TrackerPose::Sample HandMailbox::newest(int hand, int finger) const {
    const std::lock_guard lock(mutex_);
    const Hand& h = hands_[std::size_t(hand)];
    TrackerPose::Sample sample;
    sample.valid = h.frame.valid && Clock::now() - h.arrived < stale;
    sample.pose = h.frame.finger[std::size_t(finger)];
    return sample;
}

double HandMailbox::arrived_at(int hand) const {
    const std::lock_guard lock(mutex_);
    const Hand& h = hands_[std::size_t(hand)];
    if (!h.frame.valid || Clock::now() - h.arrived >= stale) return 0;
    return std::chrono::duration<double>(h.arrived.time_since_epoch()).count();
}

void take_joints(HandMailbox& mailbox, const char* text, std::size_t size, const std::string& sender) {
    std::string wrong;
    const auto json = parse_object({text, size}, wrong);
    if (!wrong.empty()) return mailbox.count_malformed(std::move(wrong));
    HandFrameUnits units;
    HandFrame frame;
    wrong = read_units(json, units);
    const auto which = json.find("hand");
    const auto name = which == json.end() ? hand_names.begin() + 1
                                          : std::find(hand_names.begin(), hand_names.end(),
                                                      which->is_string() ? which->get<std::string>() : "");
    if (wrong.empty() && name == hand_names.end())
        wrong = "hand: expected \"left\" or \"right\", found " + shown(*which);
    const auto t = json.find("t");
    if (wrong.empty() && t != json.end() && !t->is_number()) wrong = "t: expected the time in seconds";
    if (wrong.empty()) wrong = read_hand_frame(json, units, frame);
    if (!wrong.empty()) return mailbox.count_malformed(std::move(wrong));
    std::optional<double> time;
    if (t != json.end()) time = t->get<double>();
    mailbox.take(int(name - hand_names.begin()), frame, time, sender);
}

}  // namespace palpate
