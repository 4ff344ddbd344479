#pragma once
// What passes between the mesher and its TetGen helper, over one socket.

#include <cstdint>

namespace palpate {

struct TetgenRequest {
    std::int32_t vertex_count = 0, triangle_count = 0, hole_count = 0;
    double cpu_limit_s = 0, memory_limit_bytes = 0;
    char switches[64] = {};
    // then vertices [count][3] double, triangles [count][3] int32, a point in each hole [count][3] double
};

struct TetgenReply {
    std::int32_t status = 0;  ///< 0, or TetGen's terminatetetgen code
    std::int32_t node_count = 0, tet_count = 0;
    // then nodes [count][3] double, tets [count][4] int32
};

}  // namespace palpate
