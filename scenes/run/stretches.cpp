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

/// Volume, and volume times the deformation gradient.
struct Deformation {
    double volume = 0;
    Mat3<double> times_volume = Mat3<double>::zero();
};

Deformation deformation_of(const std::array<Point, 4>& rest, const std::array<Point, 4>& now) {
    const Mat3<double> D = edges(rest);
    // The rows of the inverse are cross products of columns over the determinant.
    const Vec3<double> a = D.column(0), b = D.column(1), c = D.column(2);
    const Vec3<double> rows[3] = {cross(b, c), cross(c, a), cross(a, b)};
    Mat3<double> cofactors;
    for (int i = 0; i < 3; ++i)
        cofactors.m[i][0] = rows[i].x, cofactors.m[i][1] = rows[i].y, cofactors.m[i][2] = rows[i].z;
    return {dot(a, cross(b, c)) / 6, (1.0 / 6) * (edges(now) * cofactors)};
}

Vec3<double> stretches(const Deformation& d) { return signed_svd((1 / d.volume) * d.times_volume).sigma; }

}  // namespace

Vec3<double> principal_stretches(const std::array<Point, 4>& rest, const std::array<Point, 4>& now) {
    return stretches(deformation_of(rest, now));
}

std::vector<Vec3<double>> limited_stretches(const TetMesh& mesh, const std::vector<Point>& now) {
    const std::size_t count = mesh.tets.size();
    std::vector<Vec3<double>> out(count);
    std::vector<Deformation> of_patch;
    const auto add = [&](int patch, double share, const Deformation& own) {
        if (std::size_t(patch) >= of_patch.size()) of_patch.resize(std::size_t(patch) + 1);
        Deformation& whole = of_patch[std::size_t(patch)];
        whole.volume += share * own.volume;
        whole.times_volume = whole.times_volume + share * own.times_volume;
    };
    auto share = mesh.limit_shares.begin();
    for (std::size_t e = 0; e < count; ++e) {
        const Deformation own = deformation_of(corners(mesh.nodes, mesh.tets[e]), corners(now, mesh.tets[e]));
        out[e] = stretches(own);
        if (mesh.limit_patches.empty() || mesh.limit_patches[e] < 0) continue;
        if (share == mesh.limit_shares.end() || share->tet != int(e)) add(mesh.limit_patches[e], 1, own);
        for (; share != mesh.limit_shares.end() && share->tet == int(e); ++share) add(share->patch, share->share, own);
    }
    for (std::size_t e = 0; e < mesh.limit_patches.size(); ++e)
        if (mesh.limit_patches[e] >= 0) out[e] = stretches(of_patch[std::size_t(mesh.limit_patches[e])]);
    return out;
}

}  // namespace palpate
