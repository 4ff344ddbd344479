// In the place of kernels_avx512.cpp where PALPATE_AVX512 is off: a set that names no instructions, and no processor is
// given it.
#include "engine/skin/solve/kernels.h"

namespace palpate {
const KernelSet avx512_kernels{};
}  // namespace palpate
