#include "bench/batched_baseline.h"

#include <Eigen/Dense>
#include <algorithm>
#include <chrono>
#include <cmath>

#include "bench/batched_kernel.h"
#include "engine/skin/chunks/topology.h"

namespace palpate {
namespace {

/// Who owns what BatchedFingers points to.
struct Storage {
    std::vector<int> nodes, unknown, blocks_of, column_start{0}, row, update_start{0}, update_a, update_b;
    std::vector<float> gradients, volume, position, matrix, factor, force, step;
    std::vector<std::vector<int>> block_at;  ///< [row][column]; -1: none

    explicit Storage(const TetMesh& mesh) {
        const SkinTopology t = build_topology(mesh);  // the engine's order of elimination; the rest is made here
        unknown.assign(mesh.nodes.size(), -1);
        int columns = 0;
        for (int i : t.unknowns)
            if (i < t.node_count) unknown[std::size_t(i)] = t.elimination[std::size_t(i)], ++columns;
        make_pattern(t, std::size_t(columns));
        for (const auto& tet : t.elements) add_element(mesh, tet);
        for (const Point& p : mesh.nodes)
            for (std::size_t i = 0; i < 3; ++i)
                for (int l = 0; l < batch; ++l)  // some strain, another in each finger
                    position.push_back(float(p[i] * (i == 2 ? 0.95 + 0.001 * l : 1)));
        matrix.resize(9 * batch * row.size());
        factor.resize(matrix.size());
        force.resize(3 * batch * std::size_t(columns));
        step.resize(force.size());
    }

    BatchedFingers view() {
        return {int(volume.size()) / batch,
                int(column_start.size()) - 1,
                nodes.data(),
                unknown.data(),
                blocks_of.data(),
                column_start.data(),
                row.data(),
                update_start.data(),
                update_a.data(),
                update_b.data(),
                gradients.data(),
                volume.data(),
                position.data(),
                matrix.data(),
                factor.data(),
                force.data(),
                step.data()};
    }

    /// Of the first finger.
    double residual() const {
        std::vector<double> r;
        double squared = 0, of_force = 0;
        for (std::size_t i = 0; i < force.size(); i += batch) r.push_back(double(force[i]));
        for (double f : r) of_force += f * f;
        for (std::size_t c = 0; c + 1 < column_start.size(); ++c)
            for (int b = column_start[c]; b < column_start[c + 1]; ++b)
                for (std::size_t i = 0; i < 3; ++i)
                    for (std::size_t j = 0; j < 3; ++j) {
                        const double k = double(matrix[(9 * std::size_t(b) + 3 * i + j) * batch]);
                        const std::size_t y = 3 * std::size_t(row[std::size_t(b)]) + i, x = 3 * c + j;
                        r[y] -= k * double(step[x * batch]);
                        if (b != column_start[c]) r[x] -= k * double(step[y * batch]);
                    }
        for (double f : r) squared += f * f;
        return std::sqrt(squared / of_force);
    }

  private:
    void make_pattern(const SkinTopology& t, std::size_t n) {
        block_at.assign(n, std::vector<int>(n, -1));
        std::vector<std::vector<char>> filled(n, std::vector<char>(n, 0));
        for (const auto& tet : t.elements)
            for (int a : tet)
                for (int b : tet) {
                    const int i = unknown[std::size_t(a)], j = unknown[std::size_t(b)];
                    if (i >= j && j >= 0) filled[std::size_t(i)][std::size_t(j)] = 1;
                }
        for (std::size_t j = 0; j < n; ++j) {
            std::vector<std::size_t> below;
            for (std::size_t i = j; i < n; ++i) {
                if (!filled[i][j]) continue;
                block_at[i][j] = int(row.size());
                row.push_back(int(i));
                if (i > j) below.push_back(i);
            }
            for (std::size_t a : below)
                for (std::size_t b : below)
                    if (a >= b) filled[a][b] = 1;
            column_start.push_back(int(row.size()));
        }
        for (std::size_t j = 0; j < n; ++j)
            for (int b = column_start[j]; b < column_start[j + 1]; ++b) {
                const std::size_t i = std::size_t(row[std::size_t(b)]);
                for (std::size_t k = 0; k < j; ++k)
                    if (block_at[i][k] >= 0 && block_at[j][k] >= 0)
                        update_a.push_back(block_at[i][k]), update_b.push_back(block_at[j][k]);
                update_start.push_back(int(update_a.size()));
            }
    }

    void add_element(const TetMesh& mesh, const std::array<int, 4>& tet) {
        Eigen::Matrix3d D;
        for (int a = 1; a < 4; ++a)
            for (int i = 0; i < 3; ++i)
                D(i, a - 1) = mesh.nodes[std::size_t(tet[std::size_t(a)])][std::size_t(i)] -
                              mesh.nodes[std::size_t(tet[0])][std::size_t(i)];
        const Eigen::Matrix3d inverse = D.inverse();
        for (int a = 0; a < 3; ++a)
            for (int i = 0; i < 3; ++i) gradients.insert(gradients.end(), batch, float(inverse(a, i)));
        volume.insert(volume.end(), batch, float(std::abs(D.determinant()) / 6));
        nodes.insert(nodes.end(), tet.begin(), tet.end());
        for (int a : tet)
            for (int b : tet) {
                const int i = unknown[std::size_t(a)], j = unknown[std::size_t(b)];
                blocks_of.push_back(i >= j && j >= 0 ? block_at[std::size_t(i)][std::size_t(j)] : -1);
            }
    }
};

}  // namespace

BatchedBaseline time_batched_baseline(const TetMesh& mesh) {
    Storage storage(mesh);
    const BatchedFingers fingers = storage.view();
    std::vector<double> times;
    for (int i = 0; i < 201; ++i) {
        const auto start = std::chrono::steady_clock::now();
        assemble_batch(fingers);
        solve_batch(fingers);
        times.push_back(std::chrono::duration<double, std::micro>(std::chrono::steady_clock::now() - start).count());
    }
    std::nth_element(times.begin(), times.begin() + 100, times.end());
    return {times[100] / batch, storage.residual(), fingers.elements, fingers.columns};
}

}  // namespace palpate
