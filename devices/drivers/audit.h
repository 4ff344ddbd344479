#pragma once
// What a board was sent, kept for the last minutes; and how it came from one state into the next.

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "devices/drivers/servo.h"

namespace palpate {

/// As in ros2_control. Values are sent in `active` alone; the way from `faulted` leads over `inactive` (the controller
/// is there again) and a person who re-arms.
enum class BoardState { unconfigured, inactive, active, faulted };
const char* name(BoardState state);

struct BoardTransition {
    double at;  ///< [s of device_clock]
    BoardState from, to;
    std::string reason;
};

/// One value that was sent.
struct SentValue {
    double at;  ///< when its transfer ended [s]
    float age;  ///< of the tracked pose behind it; negative where none is behind it [s]
    std::int8_t channel;
    bool arrived, torque;  ///< torque: a torque limit rather than a target
    WireValue value;
};

/// The newest of all values sent: 2 MB, three minutes of 15 servos. Written and read by the board's thread alone.
class Audit {
  public:
    static constexpr std::size_t capacity = 131072;
    Audit() : ring_(capacity) {}
    void add(const SentValue& value) { ring_[next_++ % capacity] = value; }
    /// Oldest first, as CSV, below the transitions as comments; whole, or not at all. False where it cannot be
    /// written.
    bool write(const std::filesystem::path& file, const std::vector<BoardTransition>& transitions, double now) const;

  private:
    std::vector<SentValue> ring_;
    std::size_t next_ = 0;
};

}  // namespace palpate
