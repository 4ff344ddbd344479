#pragma once
// A finger above a table, and how long its steps take: what several benches share.

#include <algorithm>
#include <string>
#include <vector>

#include "scenes/load/finger_mesh.h"

namespace palpate {

/// The built-in index finger.
inline TetMesh index_finger_mesh(int elements = 347) {
    FingerTemplates templates;
    FingerMeshRequest request;
    request.shape = finger_shape("index");
    request.elements = elements;
    std::string note;
    return make_finger_mesh(request, templates, note);
}

/// Height of its origin at which a finger touches the plane z = 0 [m].
inline double touching_height(const TetMesh& mesh) {
    double lowest = 0;
    for (const Point& p : mesh.nodes) lowest = std::min(lowest, p[2]);
    return -lowest;
}

/// Without the slowest tenth: the machine's own interruptions.
inline double trimmed_mean_us(std::vector<double> seconds) {
    std::sort(seconds.begin(), seconds.end());
    const std::size_t n = seconds.size() * 9 / 10;
    double sum = 0;
    for (std::size_t i = 0; i < n; ++i) sum += seconds[i];
    return 1e6 * sum / double(n);
}

}  // namespace palpate
