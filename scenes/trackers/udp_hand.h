#pragma once
// A live hand over UDP: one JSON object per datagram, for scripts, gloves and other trackers.

#include <cstdint>
#include <memory>
#include <string>

#include "scenes/trackers/hand_recording.h"

namespace palpate {

/// What has arrived so far.
struct UdpHandCounts {
    std::int64_t frames = 0;     ///< understood, of this hand
    std::int64_t malformed = 0;  ///< no JSON object, or not as read_hand_frame expects it
    std::string last_problem;    ///< of the last malformed one
};

/// Receives {"hand": "right", "joints": 26 x [x, y, z, qx, qy, qz, qw], "units", "up", "valid"} (metres and y up unless
/// it says otherwise; joints as in XR_EXT_hand_tracking) on a thread of its own and keeps the newest.
class UdpHand {
  public:
    /// Listens on the loopback address unless `any_address`; port 0: any free one. Throws InputError where it cannot.
    UdpHand(int port, const std::string& hand, bool any_address);
    ~UdpHand();
    int port() const;
    UdpHandCounts counts() const;
    /// Newest pose of a finger; not valid before the first frame, where the tracker says so, and once the last frame is
    /// older than 0.25 s.
    TrackerPose::Sample newest(int finger) const;

  private:
    struct State;
    std::unique_ptr<State> state_;
};

}  // namespace palpate
