// Lane types of 32 bytes, and one lane beside them: compiled for AVX2 on x86-64, for the plain target
// elsewhere.
#include "engine/skin/kernels.h"
#include "engine/skin/newton.h"

namespace palpate::kernels {
void solve_double_1_avx2(SkinChunk<double>& c, const SolverSettings& s) { solve_chunk<Lanes<double, 1>>(c, s); }
void solve_float_1_avx2(SkinChunk<float>& c, const SolverSettings& s) { solve_chunk<Lanes<float, 1>>(c, s); }
void solve_double_4(SkinChunk<double>& c, const SolverSettings& s) { solve_chunk<Lanes<double, 4>>(c, s); }
void solve_float_8(SkinChunk<float>& c, const SolverSettings& s) { solve_chunk<Lanes<float, 8>>(c, s); }
}  // namespace palpate::kernels
