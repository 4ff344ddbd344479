#include <oneapi/tbb/parallel_for.h>

#include <algorithm>

#include "engine/skin/detail.h"
#include "engine/skin/kernels.h"
#include "engine/skin/solve_skin.h"
#include "engine/systems.h"

namespace palpate {

namespace {

template <class T>
bool near_a_body(const SkinChunk<T>& c) {
    return std::any_of(c.slots.begin(), c.slots.end(),
                       [](const ContactSlot& s) { return s.object >= 0 && s.body >= 0; });
}

template <class T>
void solve_or_leave(SkinChunk<T>& c, const SolverSettings& solver) {
    if (c.rigid_lanes != 0) kernel_for(c).move_rigid(c, solver);
    if (near_a_body(c)) return;
    if (active_lanes(c) != 0) {
        solve_skin(c, solver);
        settle_lanes(c, solver);
    }
}

}  // namespace

void solve_skins(const SolverSettings& solver, oneapi::tbb::task_arena& arena,
                 std::vector<SkinChunk<double>>& double_chunks, std::vector<SkinChunk<float>>& float_chunks) {
    const int doubles = int(double_chunks.size()), all = doubles + int(float_chunks.size());
    auto solve = [&](int i) {
        if (i < doubles)
            solve_or_leave(double_chunks[i], solver);
        else
            solve_or_leave(float_chunks[i - doubles], solver);
    };
    if (all == 1) return solve(0);
    arena.execute([&] { oneapi::tbb::parallel_for(0, all, solve, oneapi::tbb::simple_partitioner()); });
}

}  // namespace palpate
