#pragma once
// The reference sketch of devices/arduino, which runs here unchanged behind a pseudo-terminal, on a clock that tests
// move.

#include <gtest/gtest.h>
#include <pty.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <map>
#include <stdexcept>
#include <string>
#include <thread>

#include "tests/arduino/computer/Arduino.h"
#include "tests/real_time.h"

namespace sketch {
using arduino::Serial;
inline unsigned long millis() { return arduino::clock_ms; }
#include "devices/arduino/palpate_servos/palpate_servos.ino"
}  // namespace sketch

namespace palpate::testing {

/// The sketch on a board whose port is a pseudo-terminal.
class SketchBoard {
  public:
    std::string port;
    std::atomic<bool> hangs{false};
    SketchBoard() {
        char name[256];
        if (openpty(&arduino::Serial.fd, &slave_, name, nullptr, nullptr) != 0) throw std::runtime_error("no pty");
        port = name;
        arduino::pulses.clear();
        for (auto& servo : sketch::outputs) servo = {};
        sketch::setup();
        ask_to_be_served_first();
        thread_ = std::thread([this] {
            play_a_controller();
            while (!stop_) {
                if (!hangs) sketch::loop();
                ++rounds_;
                usleep(200);
            }
        });
    }
    ~SketchBoard() {
        stop_ = true;
        thread_.join();
        ::close(arduino::Serial.fd);
        ::close(slave_);
        arduino::Serial.fd = -1;
    }
    /// Lets the board's time go on, in steps as its loop would see them.
    void pass(unsigned long ms) {
        for (unsigned long k = 0; k < ms; k += 2) {
            arduino::clock_ms += 2;
            const long seen = rounds_;
            while (rounds_ < seen + 2) usleep(100);
        }
    }
    /// Lets the board hang: from here on it answers nothing, not even what its loop was about to read.
    void hang() {
        hangs = true;
        for (const long seen = rounds_; rounds_ < seen + 2;) usleep(100);
    }
    /// The pulse that a pin's servo gets now; 0: none.
    static int pulse(int pin) {
        const std::lock_guard lock(arduino::pulses_mutex);
        int us = 0;
        for (const arduino::Pulse& p : arduino::pulses)
            if (p.pin == pin) us = p.us;
        return us;
    }
    /// Every pulse was in range, and changed no faster than the limit [us/s]: over any time, where a message may come
    /// `late_ms` after it was sent, as from a program that the computer lets wait.
    static void expect_bounded(double us_per_s, double late_ms = 0) {
        const std::lock_guard lock(arduino::pulses_mutex);
        const double per_ms = 1e-3 * us_per_s;
        struct Pin {
            arduino::Pulse last;
            double spare_us;  // what it may have moved while messages were late
        };
        std::map<int, Pin> pins;
        for (const arduino::Pulse& p : arduino::pulses) {
            if (p.us != 0) {
                EXPECT_GE(p.us, 900);
                EXPECT_LE(p.us, 2100);
            }
            double spare_us = per_ms * late_ms;
            const auto before = pins.find(p.pin);
            if (before != pins.end() && before->second.last.us != 0 && p.us != 0) {
                const double ms = double(p.at_ms - before->second.last.at_ms);
                const double allowed = before->second.spare_us + per_ms * std::min(ms, 50.0);
                const double moved = std::abs(p.us - before->second.last.us);
                EXPECT_LE(moved, allowed + 1);
                spare_us = std::clamp(allowed - moved, 0.0, spare_us);
            }
            pins[p.pin] = {p, spare_us};
        }
    }

  private:
    int slave_ = -1;
    std::atomic<bool> stop_{false};
    std::atomic<long> rounds_{0};
    std::thread thread_;
};

/// Lets the board's clock go with the computer's, but not while the computer does nothing for it.
class RealTime {
  public:
    RealTime()
        : thread_([this] {
              using Clock = std::chrono::steady_clock;
              play_a_controller();
              for (auto last = Clock::now(); !stop_; usleep(500)) {
                  const auto ms = std::chrono::duration_cast<std::chrono::milliseconds>(Clock::now() - last).count();
                  last += std::chrono::milliseconds(ms);
                  arduino::clock_ms += (unsigned long)std::min<long>(ms, 5);
              }
          }) {}
    ~RealTime() {
        stop_ = true;
        thread_.join();
    }

  private:
    std::atomic<bool> stop_{false};
    std::thread thread_;
};

}  // namespace palpate::testing
