#include "meshes/tetrahedralise.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "meshes/input_error.h"
#include "meshes/mesh_quality.h"
#include "meshes/remesh.h"

namespace palpate {

TetMesh tetrahedralise(const Surface& surface, const TetrahedraliseSettings& settings) {
    if (settings.elements < 20 || settings.elements > 200000)
        throw InputError("the wanted number of elements must be between 20 and 200000, found " +
                         std::to_string(settings.elements));
    if (auto wrong = check_surface(surface); !wrong.empty()) throw InputError(wrong);
    const TriangleTree reference(surface);
    Remesher remesh(reference);
    // Edge of a regular tetrahedron of the mean volume; the count is not monotone in it, so scan around.
    const double estimate = std::cbrt(8.49 * volume(surface) / settings.elements);
    std::optional<TetMesh> best;
    double best_cost = 1e300;
    std::string last_error;
    for (int k = 0; k < 29; ++k) {
        const double factor = 1 + 0.012 * ((k + 1) / 2) * (k % 2 ? 1 : -1);  // 1, 1.012, 0.988, 1.024, ...
        try {
            const Surface coarse = remesh(factor * estimate);
            TetMesh mesh = run_tetgen(coarse, "pYq1.2/15O9/7o/140", settings);
            if (!check_tets(mesh).empty()) continue;
            const double off = std::abs(double(mesh.tets.size()) / settings.elements - 1);
            const double cost = off + 0.2 * std::max(0.0, 20 - measure_quality(mesh).worst_dihedral_deg) / 20;
            if (cost < best_cost) best_cost = cost, best = std::move(mesh);
            if (best_cost < 0.02) break;
        } catch (const InputError& error) { last_error = error.messages.front(); }
    }
    if (!best)
        throw InputError("no sound mesh of about " + std::to_string(settings.elements) + " elements: " + last_error);
    best->surface = boundary(best->tets);
    return *best;
}

}  // namespace palpate
