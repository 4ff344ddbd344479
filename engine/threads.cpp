#include "engine/threads.h"

#include <oneapi/tbb/info.h>
#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/task_arena.h>

namespace palpate {

struct Threads::Arena {
    oneapi::tbb::task_arena arena;
};

Threads::Threads(int count)
    : arena_(std::make_unique<Arena>(
          Arena{oneapi::tbb::task_arena(count > 0 ? count : int(oneapi::tbb::info::default_concurrency()))})) {}
Threads::~Threads() = default;

int Threads::count() const { return arena_->arena.max_concurrency(); }

void Threads::run(int n, void (*work)(const void*, int), const void* context) {
    arena_->arena.execute([&] {
        oneapi::tbb::parallel_for(
            0, n, [&](int i) { work(context, i); }, oneapi::tbb::simple_partitioner());
    });
}

}  // namespace palpate
