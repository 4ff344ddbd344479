#include "bench/eigen_baseline.h"

#include <Eigen/Dense>
#include <Eigen/SparseCholesky>
#include <algorithm>
#include <array>
#include <chrono>

namespace palpate {
namespace {

constexpr double young = 30e3, poisson = 0.45;

struct Element {
    std::array<int, 4> nodes;
    Eigen::Matrix<double, 12, 12> stiffness;
    Eigen::Matrix3d inverse_rest;
    std::array<double*, 48> slots;  // columns of the 16 blocks in the sparse matrix; null where a node is fixed
};

Eigen::Matrix<double, 12, 12> element_stiffness(const Eigen::Matrix3d& inverse_rest, double volume) {
    const double mu = young / (2 * (1 + poisson)), lambda = young * poisson / ((1 + poisson) * (1 - 2 * poisson));
    Eigen::Matrix<double, 6, 12> B = Eigen::Matrix<double, 6, 12>::Zero();
    for (int a = 0; a < 4; ++a) {
        const Eigen::Vector3d g = a > 0 ? Eigen::Vector3d(inverse_rest.row(a - 1).transpose())
                                        : Eigen::Vector3d(-inverse_rest.colwise().sum().transpose());
        B.block<6, 3>(0, 3 * a) << g[0], 0, 0, 0, g[1], 0, 0, 0, g[2], g[1], g[0], 0, 0, g[2], g[1], g[2], 0, g[0];
    }
    Eigen::Matrix<double, 6, 6> C = Eigen::Matrix<double, 6, 6>::Zero();
    C.topLeftCorner<3, 3>().setConstant(lambda);
    for (int i = 0; i < 3; ++i) {
        C(i, i) += 2 * mu;
        C(3 + i, 3 + i) = mu;
    }
    return volume * B.transpose() * C * B;
}

class Body {
  public:
    Body(const TetMesh& mesh, bool fix_bone) : x(3, mesh.nodes.size()), unknown(mesh.nodes.size(), 0) {
        if (fix_bone)
            for (int i : mesh.bone_nodes) unknown[i] = -1;
        int n = 0;
        for (std::size_t i = 0; i < mesh.nodes.size(); ++i) {
            x.col(i) = Eigen::Map<const Eigen::Vector3d>(mesh.nodes[i].data());
            if (unknown[i] >= 0) unknown[i] = n++;
        }
        rest = x;
        add_elements(mesh, 3 * n);
        x.row(2) *= 0.95;  // some strain, so that the polar decomposition has work to do
    }

    double step_us() {
        const auto start = std::chrono::steady_clock::now();
        assemble();
        solver.factorize(matrix);
        const Eigen::VectorXd dx = solver.solve(force);
        const double us = std::chrono::duration<double, std::micro>(std::chrono::steady_clock::now() - start).count();
        sink += dx[0];
        return us;
    }
    double sink = 0;

  private:
    void add_elements(const TetMesh& mesh, int n) {
        std::vector<Eigen::Triplet<double>> pattern;
        for (const auto& tet : mesh.tets) {
            if (std::all_of(tet.begin(), tet.end(), [&](int a) { return unknown[a] < 0; })) continue;
            Eigen::Matrix3d D;
            for (int a = 1; a < 4; ++a) D.col(a - 1) = rest.col(tet[a]) - rest.col(tet[0]);
            elements.push_back({tet, element_stiffness(D.inverse(), std::abs(D.determinant()) / 6), D.inverse(), {}});
            for (int a : tet)
                for (int b : tet)
                    if (unknown[a] >= 0 && unknown[b] >= 0)
                        for (int i = 0; i < 9; ++i)
                            pattern.emplace_back(3 * unknown[a] + i / 3, 3 * unknown[b] + i % 3, 1.0);
        }
        matrix.resize(n, n);
        matrix.setFromTriplets(pattern.begin(), pattern.end());
        solver.analyzePattern(matrix);
        for (Element& e : elements)
            for (int k = 0; k < 48; ++k) {
                const int a = unknown[e.nodes[k / 12]], b = unknown[e.nodes[k / 3 % 4]];
                e.slots[k] = a >= 0 && b >= 0 ? &matrix.coeffRef(3 * a, 3 * b + k % 3) : nullptr;
            }
        force.resize(n);
    }

    void assemble() {
        force.setZero();
        std::fill(matrix.valuePtr(), matrix.valuePtr() + matrix.nonZeros(), 0.0);
        for (int i = 0; i < matrix.rows(); ++i) matrix.coeffRef(i, i) = 10;  // inertia
        for (const Element& e : elements) {
            Eigen::Matrix3d D;
            for (int a = 1; a < 4; ++a) D.col(a - 1) = x.col(e.nodes[a]) - x.col(e.nodes[0]);
            Eigen::Matrix3d R = D * e.inverse_rest;
            for (int k = 0; k < 20; ++k) {
                const Eigen::Matrix3d next = 0.5 * (R + R.inverse().transpose());
                const double change = (next - R).squaredNorm();
                R = next;
                if (change < 1e-20) break;
            }
            Eigen::Matrix<double, 12, 1> u;
            for (int a = 0; a < 4; ++a) u.segment<3>(3 * a) = R.transpose() * x.col(e.nodes[a]) - rest.col(e.nodes[a]);
            const Eigen::Matrix<double, 12, 1> f = e.stiffness * u;
            for (int a = 0; a < 4; ++a) {
                if (unknown[e.nodes[a]] < 0) continue;
                force.segment<3>(3 * unknown[e.nodes[a]]) -= R * f.segment<3>(3 * a);
                for (int b = 0; b < 4; ++b) {
                    if (unknown[e.nodes[b]] < 0) continue;
                    const Eigen::Matrix3d K = R * e.stiffness.block<3, 3>(3 * a, 3 * b) * R.transpose();
                    for (int j = 0; j < 3; ++j)
                        for (int i = 0; i < 3; ++i) e.slots[(a * 4 + b) * 3 + j][i] += K(i, j);
                }
            }
        }
    }

    Eigen::MatrixXd x, rest;
    std::vector<int> unknown;
    std::vector<Element> elements;
    Eigen::SparseMatrix<double> matrix;
    Eigen::VectorXd force;
    Eigen::SimplicialLLT<Eigen::SparseMatrix<double>, Eigen::Lower, Eigen::AMDOrdering<int>> solver;
};

double median_step_us(const TetMesh& mesh, bool fix_bone) {
    Body body(mesh, fix_bone);
    std::vector<double> times;
    for (int i = 0; i < 101; ++i) times.push_back(body.step_us());
    std::nth_element(times.begin(), times.begin() + 50, times.end());
    return times[50];
}

}  // namespace

EigenBaseline time_eigen_baseline(const TetMesh& mesh) {
    return {median_step_us(mesh, false), median_step_us(mesh, true)};
}

}  // namespace palpate
