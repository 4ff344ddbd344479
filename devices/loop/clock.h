#pragma once

#include <thread>

namespace palpate {

/// Seconds of the clock that boards and device threads run on; it never goes back.
double device_clock();

/// Has a thread served before those of lower priority (1 to 99) and before other work, where the system allows it.
/// Elsewhere they share.
void come_before_other_work(std::thread& thread, int priority);

}  // namespace palpate
