#pragma once
// What the sketch needs of Arduino, on a computer: a serial port that is a file descriptor, a clock that a test moves,
// servos that keep what they are sent.

#include <poll.h>
#include <stdint.h>
#include <string.h>
#include <unistd.h>

#include <atomic>
#include <mutex>
#include <vector>

namespace arduino {

inline std::atomic<unsigned long> clock_ms{0};

struct Pulse {
    unsigned long at_ms;
    int pin, us;  ///< 0: detached
};
inline std::mutex pulses_mutex;
inline std::vector<Pulse> pulses;  ///< every change
inline void keep_pulse(int pin, int us) {
    const std::lock_guard lock(pulses_mutex);
    pulses.push_back({clock_ms, pin, us});
}

struct SerialPort {
    int fd = -1;
    void begin(long) {}
    int available() const {
        pollfd p{fd, POLLIN, 0};
        return fd >= 0 && poll(&p, 1, 0) > 0 && (p.revents & POLLIN) ? 1 : 0;
    }
    int read() const {
        unsigned char c = 0;
        return ::read(fd, &c, 1) == 1 ? c : -1;
    }
    void write(const char* text) const {
        if (fd < 0) return;
        [[maybe_unused]] const auto n = ::write(fd, text, strlen(text));
    }
};
inline SerialPort Serial;

}  // namespace arduino
