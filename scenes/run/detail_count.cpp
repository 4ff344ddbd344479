#include "scenes/run/detail_count.h"

#include <bit>

namespace palpate {

namespace {

template <class Chunks>
void add(const Chunks& chunks, DetailCount& count) {
    for (const auto& c : chunks) {
        count.all += std::popcount(c.used_lanes);
        count.asleep += std::popcount(c.used_lanes & c.asleep_lanes);
        count.rigid += std::popcount(c.used_lanes & c.rigid_lanes);
        count.linear += std::popcount(active_lanes(c) & c.linear_lanes);
        if (c.topology->face_samples.empty()) continue;
        count.between += std::popcount(c.used_lanes);
        count.coarse += std::popcount(c.used_lanes & ~c.fine_lanes);
    }
}

}  // namespace

void count_detail(const World& world, DetailCount& count) {
    add(world.chunks.doubles, count);
    add(world.chunks.floats, count);
}

}  // namespace palpate
