#include "scenes/run/stretches.h"

#include "engine/math/svd3.h"

namespace palpate {

namespace {

Mat3<double> edges(const std::array<Point, 4>& x) {
    Mat3<double> D;
    for (std::size_t a = 1; a < 4; ++a)
        for (std::size_t d = 0; d < 3; ++d) D.m[d][a - 1] = x[a][d] - x[0][d];
    return D;
}

}  // namespace

Vec3<double> principal_stretches(const std::array<Point, 4>& rest, const std::array<Point, 4>& now) {
    const Mat3<double> D = edges(rest);
    // The rows of the inverse are cross products of columns over the determinant.
    const Vec3<double> a = D.column(0), b = D.column(1), c = D.column(2);
    const double one_over = 1 / dot(a, cross(b, c));
    const Vec3<double> rows[3] = {one_over * cross(b, c), one_over * cross(c, a), one_over * cross(a, b)};
    Mat3<double> inverse;
    for (int i = 0; i < 3; ++i) inverse.m[i][0] = rows[i].x, inverse.m[i][1] = rows[i].y, inverse.m[i][2] = rows[i].z;
    return signed_svd(edges(now) * inverse).sigma;
}

}  // namespace palpate
