#pragma once
// Where trackers leave the hands that arrive, and what is counted about them.

#include <chrono>
#include <cstdint>
#include <deque>
#include <functional>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "devices/loop/clock.h"
#include "scenes/trackers/frame_order.h"
#include "scenes/trackers/hand_recording.h"

namespace palpate {

/// What has arrived so far.
struct HandCounts {
    std::array<std::int64_t, 2> frames{};  ///< understood, of each hand that was seen
    std::int64_t malformed = 0;            ///< not as they have to be
    std::int64_t backward = 0;             ///< older than the frame before; not used
    std::int64_t lost = 0;                 ///< missing in the tracker's own numbering
    std::int64_t connections = 0;          ///< times a source that connects was reached
    std::int64_t standing = 0;             ///< of the same time as the frame before; not used
    std::int64_t standstills = 0;          ///< times a hand was lost because nothing else came of it
    std::int64_t other_sender = 0;         ///< from another sender than that in use; not used
    std::int64_t other_clock = 0;          ///< by another clock than that in use; not used
    std::int64_t fast = 0;                 ///< whose time went far faster than time does here
    double fast_s = 0, fast_lasted_s = 0;  ///< by which their times went on, and how long that took here
    std::string last_problem;              ///< of the last malformed one
    std::string sender, refused_sender;    ///< addresses: last listened to, and last refused
};

/// How regularly frames arrive, over the last few seconds.
struct HandTiming {
    double rate_Hz = 0;
    double interval_ms = 0, interval_p95_ms = 0;  ///< median and 95th percentile between arrivals
    bool has_clock = false;                       ///< frames carry the tracker's time, in seconds by all appearance
    double delay_ms = 0, delay_p95_ms = 0;        ///< of arrival beyond that of the fastest frame
};

/// Shared by a tracker's thread, which fills it, and whoever reads the newest hands.
class HandMailbox {
  public:
    using Listener = std::function<void(int hand, const HandFrame& frame)>;
    /// Calls `listener`, if there is one, from the tracker's thread for every frame of a hand that is taken.
    explicit HandMailbox(Listener listener = {}) : listener_(std::move(listener)) {}
    /// A frame of one hand; frame.valid is false where the tracker does not see it. `time` is the tracker's [s];
    /// `sender` an address, where there may be several.
    void take(int hand, const HandFrame& frame, std::optional<double> time, const std::string& sender = {});
    /// A sender has ended: another one need not wait for it.
    void forget(const std::string& sender);
    void count_malformed(std::string problem);
    void count_lost(std::int64_t frames);
    void count_connection();
    HandCounts counts() const;
    HandTiming timing() const;
    /// How far rotations and positions of all hands so far agree.
    BoneTally bones() const;
    /// Whether messages about a hand go on, and its time has stood still for so long that it is not valid any more.
    bool stands_still(int hand) const;
    /// Newest pose of a finger; not valid before the first frame, where the tracker does not see the hand, and once the
    /// last frame is older than 0.25 s.
    TrackerPose::Sample newest(int hand, int finger) const;
    /// When the hand's newest frame arrived [s of device_clock]; 0 where newest() is not valid.
    double arrived_at(int hand) const;

  private:
    using Clock = DeviceClock;
    struct Hand {
        HandFrame frame;
        Clock::time_point arrived{};
        std::optional<double> time;
        FrameOrder order;
        Clock::time_point stood_at{};  ///< when a message last came whose time stood still
        bool stands = false;           ///< it is lost by that
    };
    /// Counts what is wrong with a frame. Whether it is taken.
    bool welcome(Hand& hand, const HandFrame& frame, std::optional<double> time, const std::string& sender,
                 Clock::time_point now);
    void count_fast(const Hand& hand, double time, Clock::time_point now);
    struct Arrival {
        Clock::time_point at;
        std::optional<double> time;
    };
    Listener listener_;
    mutable std::mutex mutex_;
    std::array<Hand, 2> hands_;
    std::deque<Arrival> arrivals_;  ///< the newest
    HandCounts counts_;
    BoneTally bones_;
};

/// Takes one message of the JSON protocol, {"hand": "right", "joints": 26 x [x, y, z, qx, qy, qz, qw], "t", "units",
/// "up", "valid"}: metres and y up unless it says otherwise, joints as in XR_EXT_hand_tracking. `sender`: its address.
void take_joints(HandMailbox& mailbox, const char* text, std::size_t size, const std::string& sender = {});

}  // namespace palpate
