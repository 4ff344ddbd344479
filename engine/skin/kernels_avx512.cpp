// Registers of 64 bytes: compiled for AVX-512 on x86-64, for the plain target elsewhere.
#include "engine/skin/kernels.h"
#include "engine/skin/newton.h"

namespace palpate {
const KernelSet avx512_kernels{"AVX-512",
                               {{{1, &solve_chunk<Lanes<double, 1, 512>>},
                                 {4, &solve_chunk<Lanes<double, 4, 512>>},
                                 {8, &solve_chunk<Lanes<double, 8, 512>>}}},
                               {{{1, &solve_chunk<Lanes<float, 1, 512>>},
                                 {8, &solve_chunk<Lanes<float, 8, 512>>},
                                 {16, &solve_chunk<Lanes<float, 16, 512>>}}}};
}  // namespace palpate
