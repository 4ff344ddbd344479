// Lane types that every processor runs.
#include "engine/skin/kernels.h"
#include "engine/skin/newton.h"

namespace palpate {
const KernelSet plain_kernels{"plain",
                              {{{1, &solve_chunk<double>}, {2, &solve_chunk<Lanes<double, 2>>}}},
                              {{{1, &solve_chunk<float>}, {4, &solve_chunk<Lanes<float, 4>>}}}};
}  // namespace palpate
