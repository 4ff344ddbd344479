#include "devices/loop/device_thread.h"

#include <pthread.h>
#include <sched.h>

#include <chrono>
#include <cmath>

namespace palpate {

void come_before_other_work(pthread_t thread, int priority) {
    sched_param wanted{};
    wanted.sched_priority = priority;
    (void)pthread_setschedparam(thread, priority > 0 ? SCHED_FIFO : SCHED_OTHER, &wanted);
}

namespace {

/// Ticks that are due within this time of each other come together, and their controllers are told once [s].
constexpr double together = 0.5e-3;

}  // namespace

DeviceThread::DeviceThread(std::vector<ThimbleLoop*> loops) : loops_(std::move(loops)) {
    for (ThimbleLoop* loop : loops_) rearm(*loop, device_clock());
    thread_ = std::thread([this] { run(); });
    come_before_other_work(thread_.native_handle(), 20);
}

void DeviceThread::stop() {
    if (!thread_.joinable()) return;
    for (ThimbleLoop* loop : loops_) park(*loop);
    stop_ = true;
    thread_.join();
}

void DeviceThread::run() {
    double end = HUGE_VAL;
    while (true) {
        const double now = device_clock();
        if (stop_ && end == HUGE_VAL) {
            end = now;
            for (ThimbleLoop* loop : loops_)
                end = std::max(end, now + std::max(loop->settings.rest_within, time_to_rest(*loop)));
        }
        double next = now + 0.1;
        bool moving = false;
        for (ThimbleLoop* loop : loops_) {
            const double due = loop->next_tick;
            const bool first = loop->status.ticks == 0;
            const double at = device_clock();
            if (tick(*loop, due < at + together ? std::max(at, due) : at) && !first)
                lateness_.add(std::max(0.0, now - due));
            next = std::min(next, loop->next_tick);
            moving |= loop->status.mode != ThimbleMode::fault && !at_rest(*loop);
        }
        for (ThimbleLoop* loop : loops_) loop->driver->flush();
        if (stop_ && (!moving || now >= end)) return;
        const double wait = next - device_clock();
        if (wait > 0) std::this_thread::sleep_for(std::chrono::duration<double>(wait));
    }
}

}  // namespace palpate
