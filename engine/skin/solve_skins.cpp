#include <oneapi/tbb/parallel_for.h>

#include "engine/skin/solve_skin.h"
#include "engine/systems.h"

namespace palpate {

void solve_skins(const SolverSettings& solver, oneapi::tbb::task_arena& arena,
                 std::vector<SkinChunk<double>>& double_chunks, std::vector<SkinChunk<float>>& float_chunks) {
    const int doubles = int(double_chunks.size()), all = doubles + int(float_chunks.size());
    auto solve = [&](int i) {
        if (i < doubles) solve_skin(double_chunks[i], solver);
        else solve_skin(float_chunks[i - doubles], solver);
    };
    if (all == 1) return solve(0);
    arena.execute([&] { oneapi::tbb::parallel_for(0, all, solve, oneapi::tbb::simple_partitioner()); });
}

}  // namespace palpate
