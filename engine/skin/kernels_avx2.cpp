// Registers of 32 bytes: compiled for AVX2 on x86-64, for the plain target elsewhere.
#include "engine/skin/kernels.h"
#include "engine/skin/newton.h"

namespace palpate {
const KernelSet avx2_kernels{"AVX2",
                             {{{1, &solve_chunk<Lanes<double, 1, 256>>}, {4, &solve_chunk<Lanes<double, 4, 256>>}}},
                             {{{1, &solve_chunk<Lanes<float, 1, 256>>}, {8, &solve_chunk<Lanes<float, 8, 256>>}}}};
}  // namespace palpate
