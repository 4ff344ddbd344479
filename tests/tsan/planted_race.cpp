// A race that ThreadSanitizer must find (tests/tsan/run.sh): the finger that a task counts without asking, next to sums
// that tasks make as the step does, in which it must find none.

#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/task_arena.h>

#include <atomic>
#include <cstdio>
#include <vector>

int main(int argc, char**) {
    oneapi::tbb::task_arena arena(4);
    std::vector<long> sums(1000);
    std::atomic<long> counted{0};
    long raced = 0;
    const bool sound = argc > 1;  // any argument: without the race
    arena.execute([&] {
        oneapi::tbb::parallel_for(0, 1000, [&](int i) {
            for (int k = 0; k < 1000; ++k) sums[std::size_t(i)] += k;
            ++counted;
            if (!sound) ++raced;
        });
    });
    std::printf("%ld %ld %ld\n", sums[999], counted.load(), raced);
    return 0;
}
