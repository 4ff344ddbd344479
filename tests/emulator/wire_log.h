#pragma once
// What an emulated controller writes down, and the laws that hold for it, whatever happens.

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <map>
#include <string>
#include <vector>

namespace palpate::testing {

/// One line of a log: a target of a channel [quarter us], or an event, which is a channel below zero.
struct WireEvent {
    double time = 0;  ///< [s]
    int board = 0, channel = 0, value = 0;
};
inline constexpr int watchdog_bit = -1, unplugged = -2, plugged_in = -3;
inline constexpr int stood_still = -4;  ///< the emulation did until then, for value [ms]: what was sent came later
inline constexpr int speed_of_channel_0 = -100;  ///< less one per channel: its speed limit was set [0.25 us / 10 ms]

inline std::vector<WireEvent> read_wire_log(const std::string& file) {
    std::ifstream in(file);
    std::vector<WireEvent> out;
    for (WireEvent e; in >> e.time >> e.board >> e.channel >> e.value;) out.push_back(e);
    return out;
}

struct WireRules {
    int min = 4 * 992, max = 4 * 2000;         ///< [quarter us]
    double units_per_rad = 4 * 636.62;         ///< [quarter us]
    double speed = 6, acceleration = 200;      ///< of the loop [rad/s], [rad/s^2]
    double jitter = 1.05, timing_noise = 1.5;  ///< what boards allow above those
};

namespace wire_detail {

inline std::string at(const WireEvent& e, const char* what, double found, double most) {
    char text[200];
    std::snprintf(text, sizeof text, "channel %d at %.6f s: %s %.1f, at most %.1f; ", e.channel, e.time, what, found,
                  most);
    return text;
}

/// A servo may speed up, or set out backwards, by the acceleration limit; stop, it always may. What is read of its
/// speed is the fastest of its steps in the last 80 ms, each for as long as it truly took: whoever was held up by a
/// slow transfer sets out anew. A tenth is forgiven, and two values, for rounding. `since`: what it was told before is
/// not known, as where its watchdog bit and nobody has noticed yet [s]. `stops`: when the emulation stood still.
inline std::string too_abrupt(const std::vector<WireEvent>& told, const WireRules& r, double since,
                              const std::vector<WireEvent>& stops) {
    constexpr double longest_credit = 0.03;
    for (std::size_t k = 1; k < told.size(); ++k) {
        double recent = 0.08;
        for (const WireEvent& stop : stops)
            if (stop.time > told[k - 1].time && stop.time < told[k].time + 0.005) recent += 1e-3 * stop.value;
        if (told[k].time - since < recent) continue;
        const double step = told[k].value - told[k - 1].value;
        const double time = std::min(longest_credit, told[k].time - told[k - 1].time);
        double speed = 0;
        for (std::size_t j = k - 1; j > 0 && told[k].time - told[j].time < recent; --j) {
            const double before = told[j].value - told[j - 1].value;
            const double took = std::max(told[j].time - told[j - 1].time, 1e-4);
            if (before * step > 0) speed = std::max(speed, (std::abs(before) + 1) / took);
        }
        const double most =
            (speed + r.units_per_rad * r.timing_noise * r.acceleration * longest_credit) * time * 1.1 + 2;
        if (std::abs(step) > most) return at(told[k], "sped up to a step of", std::abs(step), most);
    }
    return "";
}

}  // namespace wire_detail

/// What is wrong with what reached servos of one board: out of range, a step faster than the speed limit (or, while the
/// board's own is a share of that, than this share), or speeding up faster than the acceleration limit. A step is no
/// faster than a pause of 0.03 s allows, and times are those of arrival, between which the program had at least as much
/// time; where it does not know which of two values has arrived, it asks the board. A servo may be elsewhere after an
/// event.
inline std::string unsafe(const std::vector<WireEvent>& events, const WireRules& r = {}) {
    constexpr double first_move_share = 1.0 / 6, longest_credit = 0.03;
    std::map<int, std::vector<WireEvent>> told;
    std::map<int, int> full_speed;  ///< the largest limit that a channel was set
    std::map<int, int> limit;
    std::string wrong;
    double bitten = -HUGE_VAL;
    std::vector<WireEvent> stops;
    for (const WireEvent& e : events)
        if (e.channel == stood_still) stops.push_back(e);
    auto start_anew = [&] {
        for (const auto& [channel, way] : told) wrong += wire_detail::too_abrupt(way, r, bitten, stops);
        told.clear();
    };
    for (const WireEvent& e : events) {
        if (e.channel <= speed_of_channel_0) {
            const int channel = speed_of_channel_0 - e.channel;
            limit[channel] = e.value;
            full_speed[channel] = int(std::ceil(r.units_per_rad / 4 * r.speed / 25));
            continue;
        }
        if (e.channel < 0) {
            if (e.channel != plugged_in && e.channel != stood_still) start_anew();
            if (e.channel == watchdog_bit) bitten = e.time;
            continue;
        }
        if (e.value < r.min || e.value > r.max) wrong += wire_detail::at(e, "value", e.value, r.max);
        std::vector<WireEvent>& way = told[e.channel];
        if (!way.empty()) {
            const bool slow = limit.count(e.channel) && limit[e.channel] < full_speed[e.channel];
            const double speed = r.units_per_rad * r.speed * r.jitter * (slow ? first_move_share : 1);
            const double time = std::min(longest_credit, e.time - way.back().time);
            const double step = std::abs(e.value - way.back().value),
                         most = std::max(speed * time, 0.5 * speed * longest_credit) + 1;
            if (step > most) wrong += wire_detail::at(e, "a step of", step, most);
        }
        way.push_back(e);
    }
    start_anew();
    return wrong.substr(0, 1000);
}

/// What was told to a board after it was unplugged, or `grace` seconds after its watchdog has bitten; where somebody
/// re-arms, before its settings were made anew. `underway` transfers more are forgiven, that a stopped program had
/// begun.
inline std::string told_after_a_latch(const std::vector<WireEvent>& events, double grace, bool rearms,
                                      int underway = 0) {
    double faulted = HUGE_VAL;
    bool moves = false;  // a watchdog that bites before that is seen as the board is opened
    for (const WireEvent& e : events) {
        if (e.channel == unplugged) faulted = std::min(faulted, e.time);
        if (e.channel == watchdog_bit && moves) faulted = std::min(faulted, e.time + grace);
        if (rearms && e.channel <= speed_of_channel_0) faulted = HUGE_VAL;
        moves = e.channel >= 0 || (moves && e.channel > speed_of_channel_0);
        if (e.channel >= 0 && e.time > faulted && --underway < 0)
            return wire_detail::at(e, "told after a fault by [s]", e.time - faulted, 0);
    }
    return "";
}

/// The newest target of each channel.
inline std::map<int, int> newest_targets(const std::vector<WireEvent>& events) {
    std::map<int, int> last;
    for (const WireEvent& e : events)
        if (e.channel >= 0) last[e.channel] = e.value;
    return last;
}

}  // namespace palpate::testing
