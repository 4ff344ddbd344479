#pragma once
// Which of the messages about one hand are taken: what stands still in time says nothing of a hand that is there now,
// and two senders at once would draw it to and fro.

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "devices/loop/clock.h"

namespace palpate {

enum class FrameVerdict {
    taken,
    overtaken,     ///< less than a second older than the newest
    standing,      ///< its time is that of the frame before, whatever it shows
    other_sender,  ///< another sender is listened to
    other_clock,   ///< one sender, or senders that cannot be told apart, with another clock than that in use
};

/// Judges frames of one hand as they come.
class FrameOrder {
  public:
    using Clock = DeviceClock;
    /// A sender, or a clock, that is in use stays so until nothing of it was taken for so long.
    static constexpr auto silence = std::chrono::seconds(2);
    /// After so many messages a sender is one that stays: some programs send every message from a port of its own.
    static constexpr int settled = 3;

    /// `time` is the tracker's [s], if it has one; `sender` an address, "" where there can be only one.
    FrameVerdict judge(Clock::time_point now, std::optional<double> time, const std::string& sender);
    /// A sender has ended, and is not waited for.
    void forget(const std::string& sender);

  private:
    struct Sender {
        std::string name;
        int messages = 0;
        Clock::time_point heard{};
    };
    struct TrackerClock {
        double time = 0;
        Clock::time_point arrived{};
        std::int64_t frames = 0;  ///< 0: none
        bool goes_on_with(double next, Clock::time_point now) const;
    };
    int messages_of(const std::string& name, Clock::time_point now);
    FrameVerdict by_clock(double time, Clock::time_point now);
    FrameVerdict by_another_clock(double time, Clock::time_point now);

    std::string sender_;
    Clock::time_point taken_{};    ///< when the newest frame was
    std::vector<Sender> senders_;  ///< heard lately, a few
    TrackerClock clock_;           ///< in use
    std::array<TrackerClock, 3> others_;
};

}  // namespace palpate
