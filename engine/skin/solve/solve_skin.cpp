#include "engine/skin/solve/solve_skin.h"

#include <algorithm>
#include <cassert>

#include "engine/skin/solve/kernels.h"

namespace palpate {

const KernelSet& best_kernels() {
#if defined(__x86_64__)
    static const KernelSet& best = [&]() -> const KernelSet& {
        if (avx512_kernels.instructions && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512vl") &&
            __builtin_cpu_supports("avx512dq"))
            return avx512_kernels;
        return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") ? avx2_kernels : plain_kernels;
    }();
    return best;
#else
    return plain_kernels;
#endif
}

template <>
const std::array<Kernel<double>, 3>& kernels_of(const KernelSet& set) {
    return set.for_double;
}
template <>
const std::array<Kernel<float>, 3>& kernels_of(const KernelSet& set) {
    return set.for_float;
}

/// The widest kernel that the fingers fill; two or more share one even where lanes stay empty, which is still faster
/// than one after the other.
template <class T>
int chunk_width(int fingers) {
    const auto& kernels = kernels_of<T>(best_kernels());
    int width = fingers > 1 ? kernels[1].width : 1;
    for (const Kernel<T>& k : kernels)
        if (k.width <= fingers) width = std::max(width, k.width);
    return width;
}

template <class T>
const Kernel<T>& kernel_for(const SkinChunk<T>& chunk) {
    const auto& kernels = kernels_of<T>(best_kernels());
    const auto* k = std::find_if(kernels.begin(), kernels.end(), [&](auto& k) { return k.width == chunk.width; });
    assert(k != kernels.end() && "no kernel of this width on this processor");
    return *k;
}

template <class T>
void solve_skin(SkinChunk<T>& chunk, const SolverSettings& settings) {
    kernel_for(chunk).solve(chunk, settings);
}

template int chunk_width<double>(int);
template int chunk_width<float>(int);
template const Kernel<double>& kernel_for(const SkinChunk<double>&);
template const Kernel<float>& kernel_for(const SkinChunk<float>&);
template void solve_skin(SkinChunk<double>&, const SolverSettings&);
template void solve_skin(SkinChunk<float>&, const SolverSettings&);

}  // namespace palpate
