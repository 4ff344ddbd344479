#pragma once

#include <pthread.h>
#include <sys/resource.h>

namespace palpate::testing {

/// What drives boards in real time is in fault where the computer stands still for a tenth of a second, rightly. So
/// that a busy one does not fail its tests, they ask for it to be served first, with all that they start from here on;
/// where that is not allowed, nothing changes.
inline void ask_to_be_served_first() { [[maybe_unused]] static const int asked = ::setpriority(PRIO_PROCESS, 0, -15); }

/// The calling thread, which plays a controller, comes before all that; a controller does not wait for a computer.
inline void play_a_controller() {
    sched_param priority{};
    priority.sched_priority = 10;
    [[maybe_unused]] const int set = ::pthread_setschedparam(::pthread_self(), SCHED_FIFO, &priority);
}

}  // namespace palpate::testing
