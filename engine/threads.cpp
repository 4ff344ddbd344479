#include "engine/threads.h"

#include <link.h>
#include <oneapi/tbb/info.h>
#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/task_arena.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <thread>

namespace palpate {

namespace {

/// Reads a byte of every page of this program's code: a page that is first run during a step makes it late, by tens of
/// microseconds.
int touch_code(dl_phdr_info* part, std::size_t, void* of) {
    const auto here = reinterpret_cast<std::uintptr_t>(of);
    bool ours = false;
    for (int i = 0; i < part->dlpi_phnum; ++i) {
        const auto& segment = part->dlpi_phdr[i];
        ours |= segment.p_type == PT_LOAD && here - (part->dlpi_addr + segment.p_vaddr) < segment.p_memsz;
    }
    if (!ours) return 0;
    for (int i = 0; i < part->dlpi_phnum; ++i) {
        const auto& segment = part->dlpi_phdr[i];
        if (segment.p_type != PT_LOAD || !(segment.p_flags & PF_X) || !(segment.p_flags & PF_R)) continue;
        const auto* code = reinterpret_cast<const volatile char*>(part->dlpi_addr + segment.p_vaddr);
        for (std::size_t at = 0; at < segment.p_memsz; at += 4096) static_cast<void>(code[at]);
    }
    return 1;
}

/// Writes to the stack that a step takes (40 kB), for the same reason.
void touch_stack() {
    constexpr std::size_t page = 4096;
    volatile char stack[12 * page];
    for (std::size_t at = 0; at < sizeof(stack); at += page) stack[at] = 0;
}

}  // namespace

struct Threads::Arena {
    oneapi::tbb::task_arena arena;
};

Threads::Threads(int count)
    : arena_(std::make_unique<Arena>(
          Arena{oneapi::tbb::task_arena(count > 0 ? count : int(oneapi::tbb::info::default_concurrency()))})) {
    // What the library does first would make the first step late, by 4 ms. Each thread waits for the others a while, so
    // that none does what another one is to do.
    const int together = std::min(this->count(), int(oneapi::tbb::info::default_concurrency()));
    const auto late = std::chrono::steady_clock::now() + std::chrono::milliseconds(5);
    std::atomic<int> here = 0;
    for_each(together, [&](int) {
        touch_stack();
        for (++here; here < together && std::chrono::steady_clock::now() < late;) std::this_thread::yield();
    });
    static const int touched = dl_iterate_phdr(touch_code, reinterpret_cast<void*>(&touch_code));
    static_cast<void>(touched);
}
Threads::~Threads() = default;

int Threads::count() const { return arena_->arena.max_concurrency(); }

void Threads::run(int n, void (*work)(const void*, int), const void* context) {
    arena_->arena.execute([&] {
        oneapi::tbb::parallel_for(
            0, n, [&](int i) { work(context, i); }, oneapi::tbb::simple_partitioner());
    });
}

}  // namespace palpate
