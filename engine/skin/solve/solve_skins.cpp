#include <algorithm>
#include <atomic>
#include <chrono>

#include "engine/skin/chunks/level_of_detail.h"
#include "engine/skin/chunks/work_memory.h"
#include "engine/skin/solve/kernels.h"
#include "engine/skin/solve/solve_skin.h"
#include "engine/systems.h"

namespace palpate {

namespace {

template <class T>
void solve_or_leave(SkinChunk<T>& c, const SolverSettings& solver) {
    if (c.rigid_lanes != 0) kernel_for(c).move_rigid(c, solver);
    if (active_lanes(c) == 0 || solved_with_others(c)) return;
    solve_skin(c, solver);
    end_slots(c, solver);
    settle_lanes(c, solver);
}

/// The same of a chunk that takes turns at `memory`; then read() reads its contact. Returns how long that took [s].
template <class T, class Read>
double solve_and_read(SkinChunk<T>& c, const SolverSettings& solver, WorkMemory& memory, Read read) {
    const unsigned read_lanes = c.used_lanes & ~c.unchanged_lanes;
    if (read_lanes == 0) return 0;
    double seconds = 0;
    with_work(c, memory, [&] {
        if (active_lanes(c) == 0) c.scratch.start_position = c.state.position;  // it sleeps, and has not moved
        solve_or_leave(c, solver);
        const auto start = std::chrono::steady_clock::now();
        read();
        seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    });
    return seconds;
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

void lend_threads(Threads& threads, SkinChunks& chunks) {
    chunks.for_each([&](auto& c) {
        const bool large = c.width == 1 && c.topology->supernodes.workers > 1;
        c.threads = large && threads.count() > 1 ? &threads : nullptr;
    });
}

double solve_skins(const SolverSettings& solver, const Table<Skin>& skins, Threads& threads, SkinChunks& chunks,
                   Table<Coupling>& couplings, Table<ContactSurface>& surfaces) {
    const int count = chunks.count();
    if (chunks.work.empty()) {
        auto solve = [&](int i) { chunks.with(i, [&](auto& c) { solve_or_leave(c, solver); }); };
        if (count == 1)
            solve(0);
        else
            threads.for_each(count, solve);
        return 0;
    }
    std::atomic<int> next = 0;
    const int together = std::min(threads.count(), int(chunks.work.size()));
    threads.for_each(together, [&](int who) {
        WorkMemory& work = chunks.work[std::size_t(who)];
        work.read_s = 0;
        for (int i = next++; i < count; i = next++)
            chunks.with(i, [&](auto& c) {
                if (has_own_work(c)) return solve_or_leave(c, solver);
                work.read_s += solve_and_read(
                    c, solver, work, [&] { extract_chunk(i, skins, solver.tolerance, chunks, couplings, surfaces); });
            });
    });
    double seconds = 0;
    for (int who = 0; who < together; ++who) seconds += chunks.work[std::size_t(who)].read_s / together;
    return seconds;
}

}  // namespace palpate
