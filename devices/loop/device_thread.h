#pragma once
// Drives thimbles in real time: one thread ticks their loops on schedule, whatever the simulation does.

#include <atomic>
#include <thread>
#include <vector>

#include "devices/loop/clock.h"
#include "devices/loop/histogram.h"
#include "devices/loop/loop.h"

namespace palpate {

class DeviceThread {
  public:
    /// The loops must outlive this. They start from where their servos are.
    explicit DeviceThread(std::vector<ThimbleLoop*> loops);
    ~DeviceThread() { stop(); }
    DeviceThread(const DeviceThread&) = delete;
    DeviceThread& operator=(const DeviceThread&) = delete;

    /// Parks what is not parked, and waits until the rest pose is reached, for rest_within at most.
    void stop();
    /// How late ticks were.
    const LatencyHistogram& lateness() const { return lateness_; }

  private:
    void run();
    std::vector<ThimbleLoop*> loops_;
    std::atomic<bool> stop_{false};
    LatencyHistogram lateness_;
    std::thread thread_;
};

}  // namespace palpate
