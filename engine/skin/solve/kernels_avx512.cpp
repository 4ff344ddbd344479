// Registers of 64 bytes: compiled for AVX-512 on x86-64, for the plain target elsewhere.
#include "engine/skin/solve/coupled.h"

namespace palpate {
const KernelSet avx512_kernels{
    "AVX-512",
    {{kernel<Lanes<double, 1, 512>>(), kernel<Lanes<double, 4, 512>>(), kernel<Lanes<double, 8, 512>>()}},
    {{kernel<Lanes<float, 1, 512>>(), kernel<Lanes<float, 8, 512>>(), kernel<Lanes<float, 16, 512>>()}}};
}  // namespace palpate
