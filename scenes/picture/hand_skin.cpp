// The rest hand's skin: round bones blended into each other, and the surface between inside and outside.

#include <algorithm>
#include <cmath>
#include <map>

#include "scenes/picture/hand.h"
#include "scenes/picture/rest_hand.h"

namespace palpate {

namespace {

using Eigen::Vector3d;

/// A cone with round ends.
struct RoundBone {
    int bone;
    Vector3d a, b;
    double ra, rb;  ///< [m]
};

std::vector<RoundBone> round_bones() {
    std::vector<RoundBone> out;
    constexpr double radius[5][4] = {{0.0150, 0.0105, 0.0095, 0.0075},
                                     {0.0105, 0.0092, 0.0080, 0.0068},
                                     {0.0108, 0.0094, 0.0082, 0.0070},
                                     {0.0104, 0.0090, 0.0078, 0.0066},
                                     {0.0094, 0.0080, 0.0069, 0.0060}};
    for (int f = 0; f < 5; ++f)
        for (int s = 0; s < 3; ++s)
            out.push_back({hand_bone(f, s), rest_joint(f, s), rest_joint(f, s + 1), radius[f][s], radius[f][s + 1]});
    // The palm: a bone to each root, the balls of thumb and little finger, the wrist and what leads to it.
    const Vector3d wrist(0.002, 0, -0.004);
    for (int f = 1; f < 5; ++f)
        out.push_back({0, wrist + Vector3d(0.012, 0.55 * rest_joint(f, 0).y(), 0),
                       rest_joint(f, 0) - Vector3d(0.004, 0, 0.002), 0.0135, 0.0118});
    out.push_back({0, {0.018, 0.012, -0.008}, {0.060, 0.020, -0.006}, 0.015, 0.011});
    out.push_back({0, {0.020, -0.018, -0.008}, {0.062, -0.030, -0.007}, 0.014, 0.010});
    for (const double side : {-1.0, 1.0})
        out.push_back({0, {0.004, 0.010 * side, -0.004}, {-0.045, 0.011 * side, -0.003}, 0.0165, 0.0185});
    return out;
}

double distance_to(const RoundBone& bone, const Vector3d& x) {
    const Vector3d axis = bone.b - bone.a;
    const double t = std::clamp((x - bone.a).dot(axis) / axis.squaredNorm(), 0.0, 1.0);
    return (x - bone.a - t * axis).norm() - (bone.ra + t * (bone.rb - bone.ra));
}

/// Distance to all of them, edges between two filled softly (within a few millimetres).
double distance_to(const std::vector<RoundBone>& bones, const Vector3d& x) {
    constexpr double soft = 0.0022;
    double sum = 0, nearest = 1e9;
    std::array<double, 64> all{};
    for (std::size_t k = 0; k < bones.size(); ++k) nearest = std::min(nearest, all[k] = distance_to(bones[k], x));
    if (nearest > 0.02) return nearest;
    for (std::size_t k = 0; k < bones.size(); ++k) sum += std::exp((nearest - all[k]) / soft);
    return nearest - soft * std::log(sum);
}

/// Surface nets: a vertex in each cell that the surface passes, a face across each edge that it cuts.
struct Nets {
    double cell = 0.0036;
    Vector3d low{-0.068, -0.078, -0.060};
    int nx = 78, ny = 52, nz = 26;
    std::vector<double> value;
    double at(int i, int j, int k) const { return value[std::size_t((k * ny + j) * nx + i)]; }
    Vector3d place(int i, int j, int k) const { return low + cell * Vector3d(i, j, k); }

    Surface surface(const std::vector<RoundBone>& bones) {
        value.resize(std::size_t(nx * ny * nz));
        for (int k = 0; k < nz; ++k)
            for (int j = 0; j < ny; ++j)
                for (int i = 0; i < nx; ++i)
                    value[std::size_t((k * ny + j) * nx + i)] = distance_to(bones, place(i, j, k));
        while (fill_crossings()) {}
        Surface out;
        std::vector<int> vertex(value.size(), -1);
        for (int k = 0; k + 1 < nz; ++k)
            for (int j = 0; j + 1 < ny; ++j)
                for (int i = 0; i + 1 < nx; ++i)
                    if (Vector3d x; crossing(i, j, k, x)) {
                        vertex[std::size_t((k * ny + j) * nx + i)] = int(out.vertices.size());
                        out.vertices.push_back({x.x(), x.y(), x.z()});
                    }
        auto cell_at = [&](int i, int j, int k) { return vertex[std::size_t((k * ny + j) * nx + i)]; };
        for (int k = 1; k + 1 < nz; ++k)
            for (int j = 1; j + 1 < ny; ++j)
                for (int i = 1; i + 1 < nx; ++i) {
                    const bool in = at(i, j, k) < 0;
                    auto quad = [&](bool other, int a, int b, int c, int d) {
                        if (other == in) return;
                        if (!in) std::swap(b, d);
                        out.triangles.push_back({a, b, c});
                        out.triangles.push_back({a, c, d});
                    };
                    quad(at(i + 1, j, k) < 0, cell_at(i, j, k), cell_at(i, j - 1, k), cell_at(i, j - 1, k - 1),
                         cell_at(i, j, k - 1));
                    quad(at(i, j + 1, k) < 0, cell_at(i, j, k), cell_at(i, j, k - 1), cell_at(i - 1, j, k - 1),
                         cell_at(i - 1, j, k));
                    quad(at(i, j, k + 1) < 0, cell_at(i, j, k), cell_at(i - 1, j, k), cell_at(i - 1, j - 1, k),
                         cell_at(i, j - 1, k));
                }
        return out;
    }

    /// Where two parts of the surface would meet in an edge or a point, both pass one cell: what is outside between
    /// them becomes inside. True where there was any.
    bool fill_crossings() {
        bool any = false;
        for (int k = 0; k + 1 < nz; ++k)
            for (int j = 0; j + 1 < ny; ++j)
                for (int i = 0; i + 1 < nx; ++i) {
                    std::array<std::size_t, 8> corner;
                    unsigned inside = 0;
                    for (int c = 0; c < 8; ++c) {
                        corner[std::size_t(c)] =
                            std::size_t(((k + (c >> 2)) * ny + j + (c >> 1 & 1)) * nx + i + (c & 1));
                        if (value[corner[std::size_t(c)]] < 0) inside |= 1u << c;
                    }
                    if (!is_crossed(inside)) continue;
                    auto depth = [&](std::size_t at) { return value[at] < 0 ? HUGE_VAL : value[at]; };
                    value[*std::min_element(corner.begin(), corner.end(),
                                            [&](std::size_t a, std::size_t b) { return depth(a) < depth(b); })] = -1e-6;
                    any = true;
                }
        return any;
    }
    /// Whether the corners of a cell that are inside, or those outside, fall into parts, or do so on one of its faces.
    static bool is_crossed(unsigned inside) {
        for (unsigned set : {inside, ~inside & 255u}) {
            unsigned part = set & (~set + 1);  // grows along edges from one corner
            for (int turn = 0; turn < 8; ++turn)
                for (int c = 0; c < 8; ++c)
                    if (part >> c & 1u)
                        for (int axis = 0; axis < 3; ++axis) part |= (1u << (c ^ (1 << axis))) & set;
            if (part != set) return true;
        }
        for (int axis = 0; axis < 3; ++axis)
            for (int side = 0; side < 2; ++side) {
                const int u = 1 << (axis + 1) % 3, v = 1 << (axis + 2) % 3, at = side << axis;
                auto in = [&](int c) { return (inside >> c & 1u) != 0; };
                if (in(at) == in(at + u + v) && in(at + u) == in(at + v) && in(at) != in(at + u)) return true;
            }
        return false;
    }

    bool crossing(int i, int j, int k, Vector3d& mean) const {
        mean.setZero();
        int count = 0;
        for (int edge = 0; edge < 12; ++edge) {
            const int axis = edge / 4, u = edge & 1, v = (edge >> 1) & 1;
            std::array<int, 3> a{i, j, k}, b;
            a[std::size_t((axis + 1) % 3)] += u, a[std::size_t((axis + 2) % 3)] += v;
            b = a, b[std::size_t(axis)] += 1;
            const double va = at(a[0], a[1], a[2]), vb = at(b[0], b[1], b[2]);
            if ((va < 0) == (vb < 0)) continue;
            mean += place(a[0], a[1], a[2]) + va / (va - vb) * (place(b[0], b[1], b[2]) - place(a[0], a[1], a[2]));
            ++count;
        }
        if (count > 0) mean /= count;
        return count > 0;
    }
};

HandSkin make_skin() {
    const std::vector<RoundBone> bones = round_bones();
    HandSkin skin;
    skin.surface = Nets().surface(bones);
    for (const Point& p : skin.surface.vertices) {
        std::array<double, hand_bone_count> d;
        d.fill(1);
        for (const RoundBone& b : bones) {
            double& least = d[std::size_t(b.bone)];
            least = std::min(least, distance_to(b, {p[0], p[1], p[2]}));
        }
        const auto first = int(std::min_element(d.begin(), d.end()) - d.begin());
        int second = first == 0 ? 1 : 0;
        for (int b = 0; b < hand_bone_count; ++b)
            if (b != first && d[std::size_t(b)] < d[std::size_t(second)]) second = b;
        const double gap = d[std::size_t(second)] - d[std::size_t(first)];
        skin.bones.push_back({first, second});
        skin.second.push_back(0.5 * std::exp(-gap / 0.0035));
    }
    return skin;
}

}  // namespace

const HandSkin& hand_skin() {
    static const HandSkin skin = make_skin();
    return skin;
}

std::vector<std::array<int, 3>> drawn_faces(const HandParts& parts) {
    const HandSkin& skin = hand_skin();
    std::vector<std::array<int, 3>> out;
    auto is_simulated_tip = [&](int vertex) {
        const int bone = skin.bones[std::size_t(vertex)][0];
        return bone > 0 && (bone - 1) % 3 == 2 && parts.finger[std::size_t((bone - 1) / 3)] >= 0 &&
               skin.second[std::size_t(vertex)] < 0.25;
    };
    for (const auto& t : skin.surface.triangles)
        if (!(is_simulated_tip(t[0]) && is_simulated_tip(t[1]) && is_simulated_tip(t[2]))) out.push_back(t);
    return out;
}

Surface posed_skin(const HandParts& parts, const HandBones& bones) {
    const HandSkin& skin = hand_skin();
    Surface out;
    out.triangles = drawn_faces(parts);
    if (parts.left)
        for (auto& t : out.triangles) std::swap(t[1], t[2]);
    for (std::size_t v = 0; v < skin.surface.vertices.size(); ++v) {
        const Point& p = skin.surface.vertices[v];
        const Vector3d rest(p[0], p[1], p[2]);
        const double w = skin.second[v];
        const Vector3d x =
            (1 - w) * (bones[std::size_t(skin.bones[v][0])] * rest) + w * (bones[std::size_t(skin.bones[v][1])] * rest);
        out.vertices.push_back({x.x(), x.y(), x.z()});
    }
    return out;
}

}  // namespace palpate
