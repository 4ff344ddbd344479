// Registers of 64 bytes: compiled for AVX-512 on x86-64, for the plain target elsewhere. Without PALPATE_AVX512 there are
// none.
#ifdef PALPATE_WITHOUT_AVX512
#include "engine/skin/solve/kernels.h"
#else
#include "engine/skin/solve/coupled.h"
#endif

namespace palpate {
#ifdef PALPATE_WITHOUT_AVX512
const KernelSet avx512_kernels{};  // names no instructions, and no processor is given it
#else
const KernelSet avx512_kernels{
    "AVX-512",
    {{kernel<Lanes<double, 1, 512>>(), kernel<Lanes<double, 4, 512>>(), kernel<Lanes<double, 8, 512>>()}},
    {{kernel<Lanes<float, 1, 512>>(), kernel<Lanes<float, 8, 512>>(), kernel<Lanes<float, 16, 512>>()}}};
#endif
}  // namespace palpate
