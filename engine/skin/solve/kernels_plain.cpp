// Lane types that every processor runs.
#include "engine/skin/solve/coupled.h"

namespace palpate {
const KernelSet plain_kernels{
    "plain", {{kernel<double>(), kernel<Lanes<double, 2>>()}}, {{kernel<float>(), kernel<Lanes<float, 4>>()}}};
}  // namespace palpate
