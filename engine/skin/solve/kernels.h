#pragma once
// The kernels of solve_skin, one function per lane type. Each lane type is instantiated in exactly one translation
// unit, so that code for a wider processor never replaces code for a plain one.

#include <array>

#include "engine/skin/chunks/chunk.h"

namespace palpate {

/// What lanes condense for bodies: minus the gradient; what contact_residual left, by the matrix that it changed; any
/// right-hand side, by the matrix as it was factored.
enum class Condense { gradient, residual, given };

/// The parts of a solve that fingers share with bodies (coupled.h).
template <class T>
struct CoupledKernel {
    void (*begin)(SkinChunk<T>&, const SolverSettings&);
    void (*evaluate)(SkinChunk<T>&, const SolverSettings&);
    void (*update)(SkinChunk<T>&, const SolverSettings&, unsigned lanes);
    void (*condense)(SkinChunk<T>&, unsigned lanes, Condense what);
    void (*direction)(SkinChunk<T>&, unsigned lanes, bool first);
    void (*restore)(SkinChunk<T>&, unsigned lanes);
    void (*contact_residual)(SkinChunk<T>&, const SolverSettings&, unsigned lanes);
    void (*move)(SkinChunk<T>&, unsigned lanes, unsigned from_here);
    unsigned (*end)(SkinChunk<T>&, const SolverSettings&, unsigned failed, unsigned converged);
};

/// Solves chunks of `width` lanes; width 0 = no such kernel.
template <class T>
struct Kernel {
    int width = 0;
    void (*solve)(SkinChunk<T>&, const SolverSettings&) = nullptr;
    void (*move_rigid)(SkinChunk<T>&, const SolverSettings&) = nullptr;
    CoupledKernel<T> coupled = {};
};

/// The kernels for one instruction set, from narrow to wide. AVX2 and AVX-512 give the same bits; the plain ones, which
/// fuse no products, differ in the last digits.
struct KernelSet {
    const char* instructions;
    std::array<Kernel<double>, 3> for_double;
    std::array<Kernel<float>, 3> for_float;
};

extern const KernelSet plain_kernels, avx2_kernels, avx512_kernels;

/// The set for this processor.
const KernelSet& best_kernels();

template <class T>
const std::array<Kernel<T>, 3>& kernels_of(const KernelSet& set);

/// The kernel of a chunk's width on this processor.
template <class T>
const Kernel<T>& kernel_for(const SkinChunk<T>& chunk);

}  // namespace palpate
