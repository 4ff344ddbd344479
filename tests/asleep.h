#pragma once
// A computer that sleeps: time that only CLOCK_BOOTTIME counts. To be included by one source of a test program, whose
// clock_gettime this then is, and that of the libraries it uses.

#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

#include <atomic>

namespace palpate::testing {

inline std::atomic<int> slept_s{0};

}  // namespace palpate::testing

extern "C" int clock_gettime(clockid_t clock, timespec* t) noexcept {
    const long failed = ::syscall(SYS_clock_gettime, clock, t);
    if (failed == 0 && clock == CLOCK_BOOTTIME) t->tv_sec += palpate::testing::slept_s;
    return int(failed);
}
