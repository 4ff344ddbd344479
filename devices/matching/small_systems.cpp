#include "devices/matching/small_systems.h"

#include <array>
#include <cmath>
#include <limits>
#include <utility>

namespace palpate {

SmallCholesky::SmallCholesky(const DeviceJacobian& H) : n(int(H.rows())) {
    for (int i = 0; i < n; ++i)
        for (int j = 0; j <= i; ++j) {
            double sum = H(i, j);
            for (int k = 0; k < j; ++k) sum -= L[i][k] * L[j][k];
            if (i == j && !(sum > 0)) n = 0;
            L[i][j] = i == j ? std::sqrt(sum) : sum / L[j][j];
        }
}

void SmallCholesky::solve(double* x) const {
    for (int i = 0; i < n; ++i) {
        for (int k = 0; k < i; ++k) x[i] -= L[i][k] * x[k];
        x[i] /= L[i][i];
    }
    solve_transposed(x);
}

void SmallCholesky::solve_transposed(double* x) const {
    for (int i = n; i-- > 0;) {
        for (int k = i + 1; k < n; ++k) x[i] -= L[k][i] * x[k];
        x[i] /= L[i][i];
    }
}

Coordinates solve_square(DeviceJacobian A, Coordinates b) {
    const int n = int(b.size());
    std::array<int, max_device_dimension> unknown{};  // which one column k stands for
    for (int k = 0; k < n; ++k) unknown[std::size_t(k)] = k;
    int rank = 0;
    double least = 0;
    for (; rank < n; ++rank) {
        int row = rank, column = rank;
        for (int j = rank; j < n; ++j)
            for (int i = rank; i < n; ++i)
                if (std::abs(A(i, j)) > std::abs(A(row, column))) row = i, column = j;
        const double pivot = std::abs(A(row, column));
        if (rank == 0) least = n * std::numeric_limits<double>::epsilon() * pivot;
        if (!(pivot > least)) break;
        for (int j = 0; j < n; ++j) std::swap(A(rank, j), A(row, j));
        for (int i = 0; i < n; ++i) std::swap(A(i, rank), A(i, column));
        std::swap(b[rank], b[row]);
        std::swap(unknown[std::size_t(rank)], unknown[std::size_t(column)]);
        for (int i = rank + 1; i < n; ++i) {
            const double factor = A(i, rank) / A(rank, rank);
            for (int j = rank + 1; j < n; ++j) A(i, j) -= factor * A(rank, j);
            b[i] -= factor * b[rank];
        }
    }
    Coordinates x(n);
    for (int k = n; k-- > 0;) {
        double sum = 0;
        if (k < rank) {
            sum = b[k];
            for (int j = k + 1; j < rank; ++j) sum -= A(k, j) * x[unknown[std::size_t(j)]];
            sum /= A(k, k);
        }
        x[unknown[std::size_t(k)]] = sum;
    }
    return x;
}

}  // namespace palpate
