#pragma once
// Which settings a sweep tries, and which reference each is held against.

#include <string>
#include <vector>

#include "scenes/load/scene.h"

namespace palpate {

/// One setting and the values that it takes. `finger.*.` and `object.*.` stand for all of them.
struct SweepAxis {
    std::string key;
    std::vector<std::string> values;
};
/// From "dt_ms=1,2,5". Throws InputError.
SweepAxis parse_axis(const std::string& text);

/// Axes of which every combination is tried, all other settings as in the scene.
using SweepBlock = std::vector<SweepAxis>;

/// Time step with iterations and precision; meshes; and, one by one, limit tolerance, contact and, where the scene has
/// them, friction and matching.
std::vector<SweepBlock> default_blocks(const Scene& scene);

/// A finer mesh is another model: points that change it have a reference of their own.
enum class SweepReference { step, mesh };

struct SweepPlan {
    std::vector<std::string> keys;                 ///< of all axes; "reference" is the last
    std::vector<std::vector<std::string>> points;  ///< [point][key]; empty: as in the scene; last: "step" or "mesh"
    double finest_dt_ms[2] = {0, 0};               ///< [SweepReference]; 0: no such points
    int finest_elements = 0;                       ///< of the scene and all points
    std::vector<std::string> fingers, objects;     ///< names
};
SweepPlan plan_sweep(const std::vector<SweepBlock>& blocks, const Scene& scene);

SweepReference reference_of(const std::vector<std::string>& values);
/// For load_scene.
std::vector<std::string> overrides_of(const SweepPlan& plan, const std::vector<std::string>& values);

}  // namespace palpate
