#pragma once

#include <pthread.h>
#include <time.h>

#include <chrono>

namespace palpate {

/// The clock that boards, thimbles and trackers run on. It never goes back, and goes on while the computer sleeps: a
/// board whose watchdog has bitten meanwhile must not be taken for one that was heard a moment ago.
struct DeviceClock {
    using duration = std::chrono::nanoseconds;
    using rep = duration::rep;
    using period = duration::period;
    using time_point = std::chrono::time_point<DeviceClock>;
    static constexpr bool is_steady = true;
    static time_point now() noexcept {
        timespec t{};
        ::clock_gettime(CLOCK_BOOTTIME, &t);
        return time_point(std::chrono::seconds(t.tv_sec) + std::chrono::nanoseconds(t.tv_nsec));
    }
};

/// The same in seconds.
inline double device_clock() { return std::chrono::duration<double>(DeviceClock::now().time_since_epoch()).count(); }

/// Has a thread served before those of lower priority (1 to 99) and before other work, where the system allows it.
/// Elsewhere, and with priority 0, they share.
void come_before_other_work(pthread_t thread, int priority);

}  // namespace palpate
