#include "engine/skin/solve_skin.h"

#include "engine/skin/kernels.h"

namespace palpate {

namespace {
bool has_avx2() {
#if defined(__x86_64__)
    return __builtin_cpu_supports("avx2");
#else
    return false;
#endif
}
}  // namespace

template <>
int widest_chunk<double>() {
    return has_avx2() ? 4 : 2;
}
template <>
int widest_chunk<float>() {
    return has_avx2() ? 8 : 4;
}

template <>
void solve_skin(SkinChunk<double>& chunk, const SolverSettings& settings) {
    switch (chunk.width) {
        case 1:
            return has_avx2() ? kernels::solve_double_1_avx2(chunk, settings)
                              : kernels::solve_double_1(chunk, settings);
        case 2:
            return kernels::solve_double_2(chunk, settings);
        default:
            return kernels::solve_double_4(chunk, settings);
    }
}
template <>
void solve_skin(SkinChunk<float>& chunk, const SolverSettings& settings) {
    switch (chunk.width) {
        case 1:
            return has_avx2() ? kernels::solve_float_1_avx2(chunk, settings) : kernels::solve_float_1(chunk, settings);
        case 4:
            return kernels::solve_float_4(chunk, settings);
        default:
            return kernels::solve_float_8(chunk, settings);
    }
}

}  // namespace palpate
