#pragma once
// The kernels of solve_skin, one function per lane type. Each lane type is instantiated in exactly one
// translation unit, so that code for a wider processor never replaces code for a plain one.

#include "engine/skin/chunk.h"

namespace palpate::kernels {

void solve_double_1(SkinChunk<double>&, const SolverSettings&);
void solve_double_1_avx2(SkinChunk<double>&, const SolverSettings&);  // AVX2 on x86-64
void solve_double_2(SkinChunk<double>&, const SolverSettings&);
void solve_double_4(SkinChunk<double>&, const SolverSettings&);  // AVX2 on x86-64
void solve_float_1(SkinChunk<float>&, const SolverSettings&);
void solve_float_1_avx2(SkinChunk<float>&, const SolverSettings&);  // AVX2 on x86-64
void solve_float_4(SkinChunk<float>&, const SolverSettings&);
void solve_float_8(SkinChunk<float>&, const SolverSettings&);  // AVX2 on x86-64

}  // namespace palpate::kernels
