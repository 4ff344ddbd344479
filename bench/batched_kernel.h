#pragma once
// The inner loops of batched_baseline.h, compiled for AVX2 and FMA where the compiler aims at x86-64. Plain pointers
// alone: nothing that another file's code could be merged with.

namespace palpate {

inline constexpr int batch = 8;  ///< fingers in a register: every number below is [...][finger]

struct BatchedFingers {
    int elements = 0, columns = 0;
    const int* nodes = nullptr;         ///< [element][4]
    const int* unknown = nullptr;       ///< [node] column; -1: fixed
    const int* blocks_of = nullptr;     ///< [element][16] block (a, b) of the lower triangle; -1: elsewhere, or fixed
    const int* column_start = nullptr;  ///< [columns + 1] first block, which is the diagonal
    const int* row = nullptr;           ///< [block]
    const int* update_start = nullptr;  ///< [block + 1]
    const int* update_a = nullptr;      ///< block -= sum of a b^T
    const int* update_b = nullptr;
    const float *gradients = nullptr, *volume = nullptr;  ///< [element][node 1..3][xyz], [element]
    const float* position = nullptr;                      ///< [node][xyz]
    float *matrix = nullptr, *factor = nullptr;           ///< [block][row][column]
    float *force = nullptr, *step = nullptr;              ///< [column][xyz]
};

void assemble_batch(const BatchedFingers& f);
void solve_batch(const BatchedFingers& f);
const char* batched_instructions();

}  // namespace palpate
