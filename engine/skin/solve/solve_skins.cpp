#include <algorithm>
#include <atomic>

#include "engine/skin/chunks/level_of_detail.h"
#include "engine/skin/chunks/work_memory.h"
#include "engine/skin/solve/kernels.h"
#include "engine/skin/solve/solve_skin.h"
#include "engine/systems.h"

namespace palpate {

namespace {

/// `work`: memory of whoever solves it, for a chunk that has none of its own.
template <class T>
void solve_or_leave(SkinChunk<T>& c, const SolverSettings& solver, WorkMemory* work) {
    if (c.rigid_lanes != 0) kernel_for(c).move_rigid(c, solver);
    if (active_lanes(c) == 0 || solved_with_others(c)) return;
    if (work)
        with_work(c, *work, [&] { solve_skin(c, solver); });
    else
        solve_skin(c, solver);
    end_slots(c, solver);
    settle_lanes(c, solver);
}

}  // namespace

bool solved_apart(const SkinChunks& chunks) {
    if (!chunks.work.empty()) return false;  // they take turns at this memory
    bool alone = false, together = false, moves_both = false;
    chunks.for_each([&](const auto& c) {
        const bool with_others = solved_with_others(c);
        together |= with_others;
        alone |= !with_others && active_lanes(c) != 0;
        moves_both |= with_others && c.rigid_lanes != 0;
    });
    return alone && together && !moves_both;
}

void solve_skins(const SolverSettings& solver, Threads& threads, SkinChunks& chunks) {
    const int count = chunks.count();
    if (chunks.work.empty()) {
        auto solve = [&](int i) { chunks.with(i, [&](auto& c) { solve_or_leave(c, solver, nullptr); }); };
        if (count == 1) return solve(0);
        return threads.for_each(count, solve);
    }
    std::atomic<int> next = 0;
    threads.for_each(std::min(threads.count(), int(chunks.work.size())), [&](int who) {
        WorkMemory& work = chunks.work[std::size_t(who)];
        for (int i = next++; i < count; i = next++) chunks.with(i, [&](auto& c) { solve_or_leave(c, solver, &work); });
    });
}

}  // namespace palpate
