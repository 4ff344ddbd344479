#pragma once
// Hands from a Leap Motion / Ultraleap service: JSON frames (version 6) over a WebSocket.

#include "scenes/trackers/hand_source.h"

namespace palpate {

inline constexpr int ultraleap_port = 6437;

/// Connects to ws://HOST:PORT/v6.json, and again whenever the connection ends.
std::unique_ptr<HandSourceThread> receive_ultraleap_hands(HandMailbox& mailbox, const std::string& host, int port);

/// Takes one message of the service: frames, and what it says beside them. `last_id` is the number of the last frame.
void take_ultraleap(HandMailbox& mailbox, const char* text, std::size_t size, std::int64_t& last_id);

/// A frame as the service sends it (millimetres, y up, microseconds), of the hands that are there.
nlohmann::json ultraleap_frame(std::int64_t id, double time, const std::array<const HandFrame*, 2>& hands);

/// Serves recorded hands at their own times, as the service would. Throws InputError where it cannot listen.
class UltraleapEmulator {
  public:
    /// Port 0: any free one. `speed`: recorded seconds per second. Hands that were not recorded are null.
    UltraleapEmulator(int port, std::array<std::shared_ptr<const HandRecording>, 2> hands, double speed, bool loop);
    ~UltraleapEmulator();
    int port() const;
    int clients() const;
    bool ended() const;  ///< the recording is over, and does not loop
    /// Ends all connections, as a service that is started anew does.
    void drop_clients();

  private:
    struct State;
    std::unique_ptr<State> state_;
};

}  // namespace palpate
