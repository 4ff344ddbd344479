#include "engine/contact/mesh_spline.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>

#ifdef __x86_64__
#include <immintrin.h>
#endif

#include "engine/contact/fitted.h"

namespace palpate {

namespace {

#define PALPATE_IN_BOTH [[gnu::always_inline]] inline

/// Weights of three neighbouring cells at `from_middle` cells off the middle one's centre, and their derivatives.
struct Spline {
    std::array<double, 3> weight, slope;
};
PALPATE_IN_BOTH Spline spline_at(double t) {
    return {{0.5 * (0.5 - t) * (0.5 - t), 0.75 - t * t, 0.5 * (0.5 + t) * (0.5 + t)}, {t - 0.5, -2 * t, t + 0.5}};
}

/// Four numbers side by side: three cells along x, and one that does not count; or four sums.
using Row = double __attribute__((vector_size(32)));

PALPATE_IN_BOTH Row weighted(const Row* v, const std::array<double, 3>& w) {
    return w[0] * v[0] + w[1] * v[1] + w[2] * v[2];
}
/// Columns: the first, second and third numbers of four rows.
struct Columns {
    Row of[3];
};
PALPATE_IN_BOTH Columns transposed(const Row& a, const Row& b, const Row& c, const Row& d) {
    const Row ab_even = __builtin_shufflevector(a, b, 0, 4, 2, 6), ab_odd = __builtin_shufflevector(a, b, 1, 5, 3, 7);
    const Row cd_even = __builtin_shufflevector(c, d, 0, 4, 2, 6), cd_odd = __builtin_shufflevector(c, d, 1, 5, 3, 7);
    return {{__builtin_shufflevector(ab_even, cd_even, 0, 1, 4, 5), __builtin_shufflevector(ab_odd, cd_odd, 0, 1, 4, 5),
             __builtin_shufflevector(ab_even, cd_even, 2, 3, 6, 7)}};
}

/// rows[k][j]: of three cells along x. False, and without second derivatives, where |value| > 1 / per_band, which may
/// be 0.
PALPATE_IN_BOTH bool find_field(const Row (&rows)[3][3], const Vec3<double>& away, double per_cell, double per_band,
                                SampledField& f) {
    const Spline x = spline_at(away.x), y = spline_at(away.y), z = spline_at(away.z);
    constexpr std::array<double, 3> bend{1, -2, 1};
    // Along y, then z, then x: by weights, slopes and second differences.
    Row value[3], slope[3];  // [k]
    for (int k = 0; k < 3; ++k) value[k] = weighted(rows[k], y.weight), slope[k] = weighted(rows[k], y.slope);
    const Row at = weighted(value, z.weight), in_y = weighted(slope, z.weight), in_z = weighted(value, z.slope);
    const Columns c = transposed(at, in_y, in_z, in_z);
    const Row sum = weighted(c.of, x.weight), sloped = weighted(c.of, x.slope);
    f.value = sum[0];
    f.gradient = per_cell * Vec3<double>{sloped[0], sum[1], sum[2]};
    if (!(std::abs(f.value) * per_band <= 1)) return false;
    const double scale = per_cell * per_cell;
    Row bent[3];
    for (int k = 0; k < 3; ++k) bent[k] = weighted(rows[k], bend);
    const Row in_yy = weighted(bent, z.weight), in_zz = weighted(value, bend), in_yz = weighted(slope, z.slope);
    const Columns second = transposed(in_zz, in_yz, in_yy, in_yy);
    const Row more = weighted(second.of, x.weight), bends = weighted(c.of, bend);
    Mat3<double>& h = f.hessian;
    h[0][0] = scale * bends[0];
    h[1][1] = scale * more[2];
    h[2][2] = scale * more[0];
    h[0][1] = h[1][0] = scale * sloped[1];
    h[0][2] = h[2][0] = scale * sloped[2];
    h[1][2] = h[2][1] = scale * more[1];
    return true;
}

PALPATE_IN_BOTH const float* row_of(const CellBlock& cells, int k, int j) {
    return cells.first + std::size_t(k) * cells.deep + std::size_t(j) * cells.up;
}

PALPATE_IN_BOTH SlopedField unit_slope(const SampledField& f, double per_band) {
    const double u = f.value * per_band, within = std::max(1 - u * u, 0.0);
    constexpr double least = fitted::least_gradient2;
    const double s = dot(f.gradient, f.gradient);
    const double m = s > least ? s : 0.5 * (s * s / least + least), dm = s > least ? 1 : s / least;
    const double inverse = 1 / std::sqrt(m), q = inverse - 1, dq = -0.5 * dm * inverse * inverse * inverse;
    const double w = within * within, dw = -4 * u * within * per_band;
    return {f.value * (1 + w * q),
            (1 + w * q + f.value * dw * q) * f.gradient + (2 * f.value * w * dq) * (f.hessian * f.gradient)};
}

PALPATE_IN_BOTH SampledField field_of(const Row (&rows)[3][3], const Vec3<double>& away, double per_cell,
                                      double per_band) {
    SampledField f;
    if (!find_field(rows, away, per_cell, per_band, f)) f.hessian = Mat3<double>::zero();
    return f;
}
PALPATE_IN_BOTH SlopedField unit_slope_of(const Row (&rows)[3][3], const Vec3<double>& away, double per_cell,
                                          double per_band) {
    SampledField f;
    if (!find_field(rows, away, per_cell, per_band, f)) return {f.value, f.gradient};
    return unit_slope(f, per_band);
}

PALPATE_IN_BOTH void read_rows(const CellBlock& cells, Row (&rows)[3][3]) {
    using Floats = float __attribute__((vector_size(16)));
    for (int k = 0; k < 3; ++k)
        for (int j = 0; j < 3; ++j) {
            Floats four;
            std::memcpy(&four, row_of(cells, k, j), sizeof four);
            rows[k][j] = __builtin_convertvector(four, Row);
        }
}

#ifdef __x86_64__
const bool has_avx2 = __builtin_cpu_supports("avx2");  // where it is asked before, not known: the bits are the same

/// No product is fused here: bits are the same.
[[gnu::target("avx2"), gnu::always_inline]] inline void read_rows_avx2(const CellBlock& cells, Row (&rows)[3][3]) {
    for (int k = 0; k < 3; ++k)
        for (int j = 0; j < 3; ++j) rows[k][j] = Row(_mm256_cvtps_pd(_mm_loadu_ps(row_of(cells, k, j))));
}
[[gnu::target("avx2")]] SampledField field_avx2(const CellBlock& cells, const Vec3<double>& away, double per_cell,
                                                double per_band) {
    Row rows[3][3];
    read_rows_avx2(cells, rows);
    return field_of(rows, away, per_cell, per_band);
}
[[gnu::target("avx2")]] SlopedField unit_slope_avx2(const CellBlock& cells, const Vec3<double>& away, double per_cell,
                                                    double per_band) {
    Row rows[3][3];
    read_rows_avx2(cells, rows);
    return unit_slope_of(rows, away, per_cell, per_band);
}
#endif

}  // namespace

SampledField plain_spline_field(const Vec3<double>& away, double per_cell, const CellBlock& cells, double bent_within) {
    Row rows[3][3];
    read_rows(cells, rows);
    return field_of(rows, away, per_cell, 1 / bent_within);
}

SampledField spline_field(const Vec3<double>& away, double per_cell, const CellBlock& cells, double bent_within) {
#ifdef __x86_64__
    if (has_avx2) return field_avx2(cells, away, per_cell, 1 / bent_within);
#endif
    return plain_spline_field(away, per_cell, cells, bent_within);
}

SlopedField of_unit_slope(const SampledField& f, double per_band) {
    return std::abs(f.value) * per_band < 1 ? unit_slope(f, per_band) : SlopedField{f.value, f.gradient};
}

SlopedField spline_of_unit_slope(const Vec3<double>& away, double per_cell, const CellBlock& cells, double per_band) {
#ifdef __x86_64__
    if (has_avx2) return unit_slope_avx2(cells, away, per_cell, per_band);
#endif
    Row rows[3][3];
    read_rows(cells, rows);
    return unit_slope_of(rows, away, per_cell, per_band);
}

}  // namespace palpate
