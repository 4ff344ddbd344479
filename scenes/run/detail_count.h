#pragma once
// What detail was left out while a scene ran.

#include "engine/world.h"

namespace palpate {

/// Steps of fingers, by how they were solved.
struct DetailCount {
    std::int64_t all = 0, asleep = 0, rigid = 0, linear = 0;
    std::int64_t between = 0, coarse = 0;  ///< with samples between nodes; these left out
};
/// In percent.
inline double share_of(std::int64_t part, std::int64_t all) { return all > 0 ? 100.0 * double(part) / double(all) : 0; }
/// Adds the step that the world has just made.
void count_detail(const World& world, DetailCount& count);

}  // namespace palpate
