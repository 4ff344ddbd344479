#pragma once

#include <sys/resource.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <thread>

namespace palpate::testing {

/// What drives boards in real time is in fault where the computer stands still for a tenth of a second, rightly. So
/// that a busy one does not fail its tests, they ask for it to be served first, with all that they start from here on;
/// where that is not allowed, nothing changes.
inline void ask_to_be_served_first() { [[maybe_unused]] static const int asked = ::setpriority(PRIO_PROCESS, 0, -15); }

/// How long the computer stood still while this lived, as a thread sees it that is served as everybody else [s].
class Standstill {
  public:
    Standstill()
        : thread_([this] {
              using Clock = std::chrono::steady_clock;
              for (auto last = Clock::now(); !stop_;) {
                  std::this_thread::sleep_for(std::chrono::milliseconds(2));
                  const auto now = Clock::now();
                  longest_ = std::max(longest_.load(), std::chrono::duration<double>(now - last).count());
                  last = now;
              }
          }) {}
    ~Standstill() {
        stop_ = true;
        thread_.join();
    }
    double longest() const { return longest_; }

  private:
    std::atomic<bool> stop_{false};
    std::atomic<double> longest_{0};
    std::thread thread_;
};

}  // namespace palpate::testing
