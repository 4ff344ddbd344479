#pragma once
// A tty in raw mode, for one program alone.

#include <chrono>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "devices/drivers/device_lock.h"
#include "devices/drivers/fault.h"

namespace palpate {

class SerialLine {
  public:
    using Clock = std::chrono::steady_clock;
    ~SerialLine() { close(); }
    SerialLine() = default;
    SerialLine(const SerialLine&) = delete;
    SerialLine& operator=(const SerialLine&) = delete;
    /// Opens the port, if it is a serial one that nobody uses, and locks it, and the USB device behind it; changes
    /// nothing, and says nothing. Throws std::runtime_error.
    void claim(const std::string& port);
    /// The same, at 57600, 115200 or 1000000 baud, for words.
    void open(const std::string& port, int baud);
    void close();
    bool is_open() const { return fd_ >= 0; }
    int fd() const { return fd_; }
    /// All of it within 100 ms, or what went wrong.
    LinkProblem write(std::span<const std::uint8_t> bytes);
    /// What comes until `end`, at least one byte; empty on timeout.
    std::vector<std::uint8_t> read(Clock::time_point end);
    /// Throws away what an earlier question may still bring, for 20 ms at most.
    void discard();

  private:
    bool wait(short what, Clock::time_point end) const;
    int fd_ = -1;
    bool exclusive_ = false;
    DeviceLock usb_;
};

}  // namespace palpate
