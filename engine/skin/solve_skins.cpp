#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

#include "engine/skin/solve_skin.h"
#include "engine/systems.h"

namespace palpate {

namespace {

template <class T>
bool near_an_object(const SkinChunk<T>& c) {
    return std::any_of(c.slots.begin(), c.slots.end(), [](const ContactSlot& s) { return s.object >= 0; });
}

template <class T>
bool near_a_body(const SkinChunk<T>& c) {
    return std::any_of(c.slots.begin(), c.slots.end(),
                       [](const ContactSlot& s) { return s.object >= 0 && s.body >= 0; });
}

/// After a solve: whether every finger of the chunk has come to rest far from everything.
template <class T>
bool has_come_to_rest(const SkinChunk<T>& c, const SolverSettings& solver) {
    if (!solver.inertia || solver.sleep_speed <= 0 || near_an_object(c)) return false;
    for (int lane = 0; lane < c.width; ++lane)
        if (((c.used_lanes >> lane) & 1u) && !(c.status[lane].converged && c.status[lane].newton_iterations <= 1))
            return false;
    const T limit = T(solver.sleep_speed);
    return std::all_of(c.state.velocity.begin(), c.state.velocity.end(), [&](T v) { return std::abs(v) < limit; }) &&
           std::all_of(c.state.bone_velocity.begin(), c.state.bone_velocity.begin() + 3 * c.width,
                       [&](T v) { return std::abs(v) < limit; });
}

template <class T>
void solve_or_sleep(SkinChunk<T>& c, const SolverSettings& solver) {
    c.unchanged = false;
    if (near_a_body(c)) return;
    if (c.asleep && same_targets(c) && !near_an_object(c)) {
        for (SkinStatus& s : c.status) s.newton_iterations = s.multiplier_updates = s.backtracks = 0;
        c.unchanged = true;
        return;
    }
    solve_skin(c, solver);
    c.asleep = has_come_to_rest(c, solver);
    if (!c.asleep) return;
    std::fill(c.state.velocity.begin(), c.state.velocity.end(), T(0));
    std::fill(c.state.bone_velocity.begin(), c.state.bone_velocity.end(), T(0));
    std::copy(c.scratch.bone_springs.begin(), c.scratch.bone_springs.begin() + 9 * c.width, c.still_spring.begin());
}

}  // namespace

void solve_skins(const SolverSettings& solver, oneapi::tbb::task_arena& arena,
                 std::vector<SkinChunk<double>>& double_chunks, std::vector<SkinChunk<float>>& float_chunks) {
    const int doubles = int(double_chunks.size()), all = doubles + int(float_chunks.size());
    auto solve = [&](int i) {
        if (i < doubles)
            solve_or_sleep(double_chunks[i], solver);
        else
            solve_or_sleep(float_chunks[i - doubles], solver);
    };
    if (all == 1) return solve(0);
    arena.execute([&] { oneapi::tbb::parallel_for(0, all, solve, oneapi::tbb::simple_partitioner()); });
}

}  // namespace palpate
