#pragma once
// The same factorisation by several threads: each takes the next supernode, and applies its updates in their order,
// waiting for those before it that are not done. Every number goes through the same operations in the same order as
// with one thread.

#include <array>
#include <atomic>
#include <thread>
#include <vector>

#include "engine/skin/factor/supernode_cholesky.h"
#include "engine/threads.h"

namespace palpate {

namespace detail {

/// A wait of less than a microsecond, mostly: the thread that is waited for is at work.
inline void wait_until_set(int& flag) {
    for (int tries = 0; std::atomic_ref<int>(flag).load(std::memory_order_acquire) == 0; ++tries) {
        if (tries > 2000) std::this_thread::yield();  // its core may have been taken from it
#if defined(__x86_64__)
        __builtin_ia32_pause();
#endif
    }
}

}  // namespace detail

/// As factor_supernodes, by up to f.workers threads. `work` has f.work_scalars for each; `done` has an element for each
/// supernode. Threads take supernodes in ascending order, so that what one waits for is always being worked on.
template <class R>
inline R factor_supernodes_together(const SupernodeFactor& f, const BlockPattern& p, const ScalarOf<R>* blocks,
                                    ScalarOf<R>* panels, ScalarOf<R>* work, const unsigned char* changed,
                                    std::vector<int>& done, Threads& threads) {
    const int count = int(f.supernodes.size()), workers = std::min(threads.count(), f.workers);
    for (int i = 0; i < count; ++i) done[std::size_t(i)] = !detail::is_changed(f.supernodes[std::size_t(i)], changed);
    std::array<R, SupernodeFactor::most_workers> bad_pivots;
    bad_pivots.fill(R(0));
    std::atomic<int> next = 0;
    threads.for_each(workers, [&](int who) {
        for (int i = next++; i < count; i = next++) {
            int& own = done[std::size_t(i)];
            if (own != 0) continue;  // only who has taken it sets it
            detail::factor_supernode<R>(f, p, f.supernodes[std::size_t(i)], blocks, panels,
                                        work + std::size_t(who) * f.work_scalars, bad_pivots[std::size_t(who)],
                                        [&](int source) { detail::wait_until_set(done[std::size_t(source)]); });
            std::atomic_ref<int>(own).store(1, std::memory_order_release);
        }
    });
    R all(0);
    for (const R& bad : bad_pivots) all += bad;
    return all;
}

}  // namespace palpate
