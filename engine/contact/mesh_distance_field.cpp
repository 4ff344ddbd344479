// The smooth field of a mesh: quadratic B-splines over exact distances at the centres of a grid's cells; over finer
// cells, or the exact distance itself, where walls are too thin for those.

#include "engine/contact/mesh_distance_field.h"

#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "engine/contact/fitted.h"
#include "engine/contact/mesh_spline.h"

namespace palpate {

namespace {

using Vec = Vec3<double>;
using Fine = DistanceMesh::Fine;

using namespace fitted;

/// The cell of a grid that x lies in, or the one nearest to x; `away`: from its centre to x, in cells.
std::array<int, 3> cell_of(const Vec& x, const Vec& low, double cell, const std::array<int, 3>& cells, Vec& away) {
    const Vec relative = (1 / cell) * (x - low);
    std::array<int, 3> at;
    for (int d = 0; d < 3; ++d) {
        at[d] = int(std::clamp(relative[d], 0.0, cells[d] - 0.5));
        away[d] = relative[d] - (at[d] + 0.5);
    }
    return at;
}

std::size_t index_of(const std::array<int, 3>& at, const std::array<int, 3>& cells) {
    return (std::size_t(at[2]) * cells[1] + at[1]) * cells[0] + at[0];
}

/// Cell of the coarse grid.
std::size_t coarse_cell(const DistanceMesh& mesh, const Vec& x, Vec& away) {
    return index_of(cell_of(x, mesh.grid_low, mesh.cell, mesh.cells, away), mesh.cells);
}

/// Where the smooth field is asked for. Found and used in one go: contact asks for every sample of a pad.
struct Place {
    std::size_t cell;  ///< of the coarse grid
    Vec away;          ///< from its centre [cells]
    double per_cell;   ///< one over its edge [1/m]
};
/// False where the field's 3x3x3 cells around x are not all there.
[[gnu::always_inline]] inline bool find_place(const DistanceMesh& mesh, const Vec& x, Place& place) {
    place.per_cell = mesh.per_cell;
    const Vec relative = place.per_cell * (x - mesh.grid_low);
    std::array<int, 3> at;
    for (int d = 0; d < 3; ++d) {
        if (!(relative[d] >= 1 && relative[d] < mesh.cells[d] - 1)) return false;
        at[d] = int(relative[d]);
        place.away[d] = relative[d] - (at[d] + 0.5);
    }
    place.cell = index_of(at, mesh.cells);
    return true;
}

/// The 3x3x3 cells of the coarse grid around it.
CellBlock coarse_cells(const DistanceMesh& mesh, const Place& place) {
    const std::size_t up = std::size_t(mesh.cells[0]), deep = up * mesh.cells[1];
    return {&mesh.grid.distance[place.cell - deep - up - 1], up, deep};
}

/// Splines over which of those cells are marked so: a share between 0 and 1.
SampledField marked_field(const DistanceMesh& mesh, const Place& place, unsigned char mark) {
    const std::size_t up = std::size_t(mesh.cells[0]), deep = up * mesh.cells[1];
    const unsigned char* first = &mesh.fine.wall[place.cell - deep - up - 1];
    float marked[28] = {};
    for (std::size_t i = 0; i < 27; ++i) marked[i] = (first[i / 9 * deep + i / 3 % 3 * up + i % 3] & mark) != 0;
    return spline_field(place.away, place.per_cell, {marked, 3, 9});
}

SampledField exact_field(const DistanceMesh& mesh, const Vec& x, int guess) {
    const MeshPoint p = signed_point(mesh, nearest_triangle(mesh, x, guess));
    return {p.distance, p.normal, Mat3<double>::zero()};
}

constexpr int brick_cells = 8, brick_edge = brick_cells + 2;  ///< a brick knows its neighbours' outermost cells

/// Splines over fine cells; exact where there are none.
SampledField fine_field(const DistanceMesh& mesh, const Vec& x, int guess) {
    const Fine& fine = mesh.fine;
    if (fine.cell <= 0) return exact_field(mesh, x, guess);
    const double per_cell = 1 / fine.cell;
    const Vec relative = per_cell * (x - mesh.grid_low);
    std::array<int, 3> cell, brick;
    Vec away;
    for (int d = 0; d < 3; ++d) {
        cell[d] = int(relative[d]);
        brick[d] = cell[d] / brick_cells;
        if (!(relative[d] >= 0 && brick[d] < fine.bricks[d])) return exact_field(mesh, x, guess);
        away[d] = relative[d] - (cell[d] + 0.5);
        cell[d] -= brick_cells * brick[d];
    }
    const int index = fine.brick[index_of(brick, fine.bricks)];
    if (index < 0) return exact_field(mesh, x, guess);
    const float* first = &fine.distance[std::size_t(index) * brick_edge * brick_edge * brick_edge];
    first += (cell[2] * brick_edge + cell[1]) * brick_edge + cell[0];
    return spline_field(away, per_cell, {first, brick_edge, brick_edge * brick_edge});
}

/// a + w (b - a).
SampledField blend(const SampledField& a, const SampledField& b, const SampledField& w) {
    const double d = b.value - a.value;
    const Vec dg = b.gradient - a.gradient;
    return {
        a.value + w.value * d, a.gradient + w.value * dg + d * w.gradient,
        a.hessian + w.value * (b.hessian - a.hessian) + outer(w.gradient, dg) + outer(dg, w.gradient) + d * w.hessian};
}

/// At walls that cells do not resolve.
[[gnu::noinline]] SampledField walled_field(const DistanceMesh& mesh, const Vec& x, const Place& place,
                                            unsigned char kind) {
    auto share = [&](unsigned char mark) { return marked_field(mesh, place, mark); };
    const int guess = mesh.grid.triangle[place.cell];
    SampledField at = kind & Fine::all_thinnest ? exact_field(mesh, x, guess) : fine_field(mesh, x, guess);
    if ((kind & Fine::some_thinnest) && !(kind & Fine::all_thinnest))
        at = blend(at, exact_field(mesh, x, guess), share(Fine::thinnest));
    if (kind & Fine::all_thin) return at;
    return blend(spline_field(place.away, place.per_cell, coarse_cells(mesh, place)), at, share(Fine::thin));
}

[[gnu::always_inline]] inline MeshPoint smooth_point(const DistanceMesh& mesh, const Vec& x, const Place& place) {
    const unsigned char kind = mesh.fine.wall.empty() ? 0 : mesh.fine.wall[place.cell];
    const double per_band = 2 * place.per_cell;
    const SlopedField at = kind & Fine::some_thin
                               ? of_unit_slope(walled_field(mesh, x, place, kind), per_band)
                               : spline_of_unit_slope(place.away, place.per_cell, coarse_cells(mesh, place), per_band);
    return {at.value, at.gradient};
}

/// Where no smooth field is.
[[gnu::noinline]] MeshPoint exact_contact_distance(const DistanceMesh& mesh, const Vec& x) {
    if (!(dot(x, x) < 1e12)) return {1e6, {0, 0, 1}};
    Vec away;
    const std::size_t cell = coarse_cell(mesh, x, away);
    const double least = mesh.grid.distance[cell] - mesh.cell * norm(away) - 1e-6;
    if (least > contact_band) {
        const double length = norm(away);
        return {least, length > 0 ? (1 / length) * away : Vec{0, 0, 1}};
    }
    return signed_point(mesh, nearest_triangle(mesh, x, mesh.grid.triangle[cell]));
}

void set_grid(DistanceMesh& mesh, double smoothing) {
    std::array<Vec, 2> box{Vec{1e300, 1e300, 1e300}, Vec{-1e300, -1e300, -1e300}};
    double longest = 0;
    for (int d = 0; d < 3; ++d) {
        for (const Point& p : mesh.surface.vertices)
            box[0][d] = std::min(box[0][d], p[d]), box[1][d] = std::max(box[1][d], p[d]);
        longest = std::max(longest, box[1][d] - box[0][d]);
    }
    const double margin = 3 * contact_band;
    mesh.smooth = smoothing != 0;
    mesh.cell = std::max(smoothing > 0 ? smoothing : (longest + 2 * margin) / 48, (longest + 2 * margin) / 128);
    mesh.per_cell = 1 / mesh.cell;
    for (int d = 0; d < 3; ++d) {
        mesh.grid_low[d] = box[0][d] - margin;
        mesh.cells[d] = int(std::ceil((box[1][d] - box[0][d] + 2 * margin) / mesh.cell));
    }
    DistanceMesh::Grid grid;
    const std::size_t count = std::size_t(mesh.cells[0]) * mesh.cells[1] * mesh.cells[2];
    grid.distance.reserve(count + 1), grid.triangle.reserve(count);
    for (int k = 0; k < mesh.cells[2]; ++k)
        for (int j = 0; j < mesh.cells[1]; ++j)
            for (int i = 0; i < mesh.cells[0]; ++i) {
                const Found f = nearest_triangle(mesh, mesh.grid_low + mesh.cell * Vec{i + 0.5, j + 0.5, k + 0.5}, 0);
                grid.distance.push_back(float(signed_point(mesh, f).distance));
                grid.triangle.push_back(f.triangle);
            }
    grid.distance.push_back(0);  // read beside the last cell, for nothing
    mesh.grid = std::move(grid);
}

/// Calls visit(index) for the cells at most `reach` cells from the one at `at`.
template <class Visit>
void for_each_neighbour(const DistanceMesh& mesh, const std::array<int, 3>& at, int reach, Visit visit) {
    std::array<int, 3> low, high;
    for (int d = 0; d < 3; ++d)
        low[d] = std::max(at[d] - reach, 0), high[d] = std::min(at[d] + reach, mesh.cells[d] - 1);
    for (int k = low[2]; k <= high[2]; ++k)
        for (int j = low[1]; j <= high[1]; ++j)
            for (int i = low[0]; i <= high[0]; ++i) visit(index_of({i, j, k}, mesh.cells));
}

/// Marks the cells around a wall's points: within a cell of them the coarse field has no say.
void mark(DistanceMesh& mesh, const std::vector<WallPoint>& walls, double thinner_than, unsigned char kind) {
    for (const WallPoint& w : walls) {
        if (w.thickness >= thinner_than) continue;
        Vec away;
        const std::array<int, 3> at = cell_of(w.point, mesh.grid_low, mesh.cell, mesh.cells, away);
        for_each_neighbour(mesh, at, 2, [&](std::size_t i) { mesh.fine.wall[i] |= kind; });
    }
}

/// Which cells have marked ones around them, or none but marked ones.
void summarise_marks(DistanceMesh& mesh) {
    for (int k = 0; k < mesh.cells[2]; ++k)
        for (int j = 0; j < mesh.cells[1]; ++j)
            for (int i = 0; i < mesh.cells[0]; ++i) {
                unsigned char some = 0, all = Fine::thin | Fine::thinnest;
                for_each_neighbour(mesh, {i, j, k}, 1,
                                   [&](std::size_t n) { some |= mesh.fine.wall[n], all &= mesh.fine.wall[n]; });
                unsigned char& own = mesh.fine.wall[index_of({i, j, k}, mesh.cells)];
                own |= (some & Fine::thin ? Fine::some_thin : 0) | (all & Fine::thin ? Fine::all_thin : 0) |
                       (some & Fine::thinnest ? Fine::some_thinnest : 0) |
                       (all & Fine::thinnest ? Fine::all_thinnest : 0);
            }
}

/// Where bricks of fine cells are needed: near the surface, at thin walls that they resolve. False: too many.
bool choose_bricks(DistanceMesh& mesh, std::vector<Vec>& corners) {
    Fine& fine = mesh.fine;
    const double edge = brick_cells * fine.cell;
    for (int d = 0; d < 3; ++d) fine.bricks[d] = int(std::ceil(mesh.cells[d] * mesh.cell / edge));
    if (double(fine.bricks[0]) * fine.bricks[1] * fine.bricks[2] > 1e7) return false;
    fine.brick.assign(std::size_t(fine.bricks[0]) * fine.bricks[1] * fine.bricks[2], -1);
    for (int k = 0; k < fine.bricks[2]; ++k)
        for (int j = 0; j < fine.bricks[1]; ++j)
            for (int i = 0; i < fine.bricks[0]; ++i) {
                const Vec low = mesh.grid_low + edge * Vec{double(i), double(j), double(k)};
                const Vec middle = low + 0.5 * edge * Vec{1, 1, 1};
                Vec away;
                const std::size_t near = coarse_cell(mesh, middle, away);
                const double reach = 0.87 * edge + 2 * fine.cell;
                if (std::abs(mesh.grid.distance[near]) > reach + mesh.cell * norm(away)) continue;
                bool thin = false, resolved = false;  // in some cell that the brick reaches into
                const int around = int(std::ceil(0.5 * edge / mesh.cell));
                for_each_neighbour(mesh, cell_of(middle, mesh.grid_low, mesh.cell, mesh.cells, away), around,
                                   [&](std::size_t n) {
                                       thin |= (mesh.fine.wall[n] & Fine::some_thin) != 0;
                                       resolved |= !(mesh.fine.wall[n] & Fine::all_thinnest);
                                   });
                if (!thin || !resolved) continue;
                const MeshPoint exact = signed_point(mesh, nearest_triangle(mesh, middle, mesh.grid.triangle[near]));
                const Vec& n = exact.normal;  // as wide as the brick is along it
                const double half = 0.5 * edge * (std::abs(n.x) + std::abs(n.y) + std::abs(n.z)) + 2 * fine.cell;
                if (std::abs(exact.distance) > half) continue;
                if (int(corners.size()) == most_bricks) return false;
                fine.brick[index_of({i, j, k}, fine.bricks)] = int(corners.size());
                corners.push_back(low);
            }
    return true;
}

void fill_bricks(DistanceMesh& mesh, const std::vector<Vec>& corners) {
    constexpr std::size_t size = std::size_t(brick_edge) * brick_edge * brick_edge;
    Fine& fine = mesh.fine;
    fine.distance.resize(corners.size() * size + 1);
    oneapi::tbb::parallel_for(0, int(corners.size()), [&](int brick) {
        float* out = &fine.distance[brick * size];
        int guess = 0;
        for (int k = 0; k < brick_edge; ++k)
            for (int j = 0; j < brick_edge; ++j)
                for (int i = 0; i < brick_edge; ++i) {
                    const Found f =
                        nearest_triangle(mesh, corners[brick] + fine.cell * Vec{i - 0.5, j - 0.5, k - 0.5}, guess);
                    guess = f.triangle;
                    *out++ = float(signed_point(mesh, f).distance);
                }
    });
}

/// Finer cells where walls are thin: as fine as the thinner walls ask for; still thinner ones are exact, and so are all
/// thin ones where that would be too many cells.
void refine_walls(DistanceMesh& mesh) {
    std::vector<WallPoint> walls = thin_walls(mesh, 0.5 * mesh.cell, resolved * mesh.cell);
    if (walls.empty()) return;
    std::sort(walls.begin(), walls.end(), [](auto& a, auto& b) { return a.thickness < b.thickness; });
    Fine& fine = mesh.fine;
    fine.thinnest_wall = walls[walls.size() / 100].thickness;
    fine.cell = walls[walls.size() / 4].thickness / well_resolved;
    fine.wall.assign(mesh.grid.distance.size(), 0);
    mark(mesh, walls, 1e300, Fine::thin);
    mark(mesh, walls, resolved * fine.cell, Fine::thinnest);
    summarise_marks(mesh);
    std::vector<Vec> corners;
    if (choose_bricks(mesh, corners)) return fill_bricks(mesh, corners);
    fine.cell = 0;
    fine.bricks = {0, 0, 0};
    fine.brick.clear();
}

}  // namespace

void build_field(DistanceMesh& mesh, double smoothing) {
    set_grid(mesh, smoothing);
    if (mesh.smooth) refine_walls(mesh);
}

MeshPoint mesh_distance(const DistanceMesh& mesh, const Vec3<double>& x) {
    if (!(dot(x, x) < 1e12)) return {1e6, {0, 0, 1}};
    Vec away;
    return signed_point(mesh, nearest_triangle(mesh, x, mesh.grid.triangle[coarse_cell(mesh, x, away)]));
}

MeshPoint mesh_contact_distance(const DistanceMesh& mesh, const Vec3<double>& x) {
    if (Place place; mesh.smooth && find_place(mesh, x, place)) return smooth_point(mesh, x, place);
    return exact_contact_distance(mesh, x);
}

MeshPoint mesh_surface_distance(const DistanceMesh& mesh, const Vec3<double>& x) {
    Place place;
    if (!mesh.smooth || !find_place(mesh, x, place)) return mesh_distance(mesh, x);
    const MeshPoint smooth = smooth_point(mesh, x, place);
    // In the outermost cells the smooth field goes over to the exact one: its jump would throw bodies.
    const Vec at = place.per_cell * (x - mesh.grid_low);
    int axis = 0;
    double within = 1e300, sign = 1;
    for (int d = 0; d < 3; ++d)
        for (const auto& [depth, side] : {std::pair{at[d] - 1, 1.0}, std::pair{mesh.cells[d] - 1 - at[d], -1.0}})
            if (depth < within) within = depth, axis = d, sign = side;
    const double u = within / rim_cells;
    if (u >= 1) return smooth;
    const MeshPoint exact = mesh_distance(mesh, x);
    const double w = u * u * (3 - 2 * u), slope = 6 * u * (1 - u) * place.per_cell / rim_cells;
    const double difference = smooth.distance - exact.distance;
    MeshPoint out{exact.distance + w * difference, exact.normal + w * (smooth.normal - exact.normal)};
    out.normal[axis] += sign * slope * difference;
    return out;
}

}  // namespace palpate
