// Lane types that every processor runs.
#include "engine/skin/kernels.h"
#include "engine/skin/newton.h"

namespace palpate::kernels {
void solve_double_1(SkinChunk<double>& c, const SolverSettings& s) { solve_chunk<double>(c, s); }
void solve_double_2(SkinChunk<double>& c, const SolverSettings& s) { solve_chunk<Lanes<double, 2>>(c, s); }
void solve_float_1(SkinChunk<float>& c, const SolverSettings& s) { solve_chunk<float>(c, s); }
void solve_float_4(SkinChunk<float>& c, const SolverSettings& s) { solve_chunk<Lanes<float, 4>>(c, s); }
}  // namespace palpate::kernels
