// Registers of 32 bytes: compiled for AVX2 on x86-64, for the plain target elsewhere.
#include "engine/skin/solve/coupled.h"

namespace palpate {
const KernelSet avx2_kernels{"AVX2",
                             {{kernel<Lanes<double, 1, 256>>(), kernel<Lanes<double, 4, 256>>()}},
                             {{kernel<Lanes<float, 1, 256>>(), kernel<Lanes<float, 8, 256>>()}}};
}  // namespace palpate
