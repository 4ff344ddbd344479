#pragma once

#include <sys/resource.h>

namespace palpate::testing {

/// What drives boards in real time is in fault where the computer stands still for a tenth of a second, rightly. So
/// that a busy one does not fail its tests, they ask for it to be served first, with all that they start from here on;
/// where that is not allowed, nothing changes.
inline void ask_to_be_served_first() { [[maybe_unused]] static const int asked = ::setpriority(PRIO_PROCESS, 0, -15); }

}  // namespace palpate::testing
