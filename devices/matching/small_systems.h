#pragma once
// Linear systems of as many unknowns as a device has: at most six, without allocation. One text for all of them; each
// factorisation of Eigen's takes the compiler seconds for matrices of this kind.

#include "devices/device.h"

namespace palpate {

/// L of H = L L' (Cholesky); `n` is 0 where H is not positive definite.
struct SmallCholesky {
    double L[max_device_dimension][max_device_dimension];
    int n;

    explicit SmallCholesky(const DeviceJacobian& H);
    /// x <- H^-1 x.
    void solve(double* x) const;
    /// x <- L'^-1 x.
    void solve_transposed(double* x) const;
};

/// x of A x = b by elimination with complete pivoting. Where A is singular, what its rows leave open is zero.
Coordinates solve_square(DeviceJacobian A, Coordinates b);

}  // namespace palpate
