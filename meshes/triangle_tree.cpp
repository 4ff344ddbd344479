#include "meshes/triangle_tree.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <limits>
#include <numeric>

namespace palpate {

using Eigen::Vector3d;

TriangleTree::TriangleTree(const Surface& surface) : surface_(surface), order_(surface.triangles.size()) {
    std::iota(order_.begin(), order_.end(), 0);
    nodes_.reserve(2 * order_.size() + 1);
    if (!order_.empty()) build(0, static_cast<int>(order_.size()));
}

int TriangleTree::build(int begin, int end) {
    const int index = static_cast<int>(nodes_.size());
    nodes_.emplace_back();
    Vector3d low = Vector3d::Constant(std::numeric_limits<double>::max()), high = -low;
    for (int i = begin; i < end; ++i)
        for (int k = 0; k < 3; ++k) {
            low = low.cwiseMin(corner(order_[i], k));
            high = high.cwiseMax(corner(order_[i], k));
        }
    int left = -1, right = -1;
    if (end - begin > 4) {
        int axis;
        (high - low).maxCoeff(&axis);
        const int middle = (begin + end) / 2;
        auto centre = [&](int t) { return corner(t, 0)[axis] + corner(t, 1)[axis] + corner(t, 2)[axis]; };
        std::nth_element(order_.begin() + begin, order_.begin() + middle, order_.begin() + end,
                         [&](int a, int b) { return centre(a) < centre(b); });
        left = build(begin, middle);
        right = build(middle, end);
    }
    nodes_[index] = {low, high, left, right, begin, end};
    return index;
}

void TriangleTree::nearest_below(int n, const Vector3d& x, Found& best) const {
    const Node& node = nodes_[n];
    auto box_distance = [&](int i) { return (x - x.cwiseMax(nodes_[i].low).cwiseMin(nodes_[i].high)).squaredNorm(); };
    if (node.left < 0) {
        for (int i = node.begin; i < node.end; ++i) {
            const Vector3d p = nearest_on_triangle(x, corner(order_[i], 0), corner(order_[i], 1), corner(order_[i], 2));
            if ((p - x).squaredNorm() < best.squared_distance) best = {(p - x).squaredNorm(), p, order_[i]};
        }
        return;
    }
    const double dl = box_distance(node.left), dr = box_distance(node.right);
    const int first = dl < dr ? node.left : node.right, second = dl < dr ? node.right : node.left;
    if (std::min(dl, dr) < best.squared_distance) nearest_below(first, x, best);
    if (std::max(dl, dr) < best.squared_distance) nearest_below(second, x, best);
}

TriangleTree::Found TriangleTree::find(const Vector3d& x) const {
    Found best{std::numeric_limits<double>::max(), x, -1};
    if (!nodes_.empty()) nearest_below(0, x, best);
    return best;
}

Vector3d TriangleTree::nearest(const Vector3d& x) const { return find(x).point; }

int TriangleTree::nearest_triangle(const Vector3d& x) const { return find(x).triangle; }

// Ericson, Real-Time Collision Detection, section 5.1.5: by Voronoi regions.
Vector3d nearest_on_triangle(const Vector3d& p, const Vector3d& a, const Vector3d& b, const Vector3d& c) {
    const Vector3d ab = b - a, ac = c - a, ap = p - a, bp = p - b, cp = p - c;
    const double d1 = ab.dot(ap), d2 = ac.dot(ap), d3 = ab.dot(bp), d4 = ac.dot(bp), d5 = ab.dot(cp), d6 = ac.dot(cp);
    if (d1 <= 0 && d2 <= 0) return a;
    if (d3 >= 0 && d4 <= d3) return b;
    if (d6 >= 0 && d5 <= d6) return c;
    const double vc = d1 * d4 - d3 * d2, vb = d5 * d2 - d1 * d6, va = d3 * d6 - d5 * d4;
    if (vc <= 0 && d1 >= 0 && d3 <= 0) return a + d1 / (d1 - d3) * ab;
    if (vb <= 0 && d2 >= 0 && d6 <= 0) return a + d2 / (d2 - d6) * ac;
    if (va <= 0 && d4 - d3 >= 0 && d5 - d6 >= 0) return b + (d4 - d3) / ((d4 - d3) + (d5 - d6)) * (c - b);
    const double s = va + vb + vc;
    return s > 0 ? Vector3d(a + vb / s * ab + vc / s * ac) : a;
}

namespace {

double orient(const Vector3d& a, const Vector3d& b, const Vector3d& c, const Vector3d& d) {
    return (b - a).cross(c - a).dot(d - a);
}

/// Whether the open segment pq passes through the triangle.
bool segment_crosses(const Vector3d& p, const Vector3d& q, const Vector3d t[3], double tolerance) {
    const double sp = orient(t[0], t[1], t[2], p), sq = orient(t[0], t[1], t[2], q);
    if (std::abs(sp) < tolerance || std::abs(sq) < tolerance || (sp > 0) == (sq > 0)) return false;
    const double a = orient(p, q, t[0], t[1]), b = orient(p, q, t[1], t[2]), c = orient(p, q, t[2], t[0]);
    return (a > tolerance && b > tolerance && c > tolerance) || (a < -tolerance && b < -tolerance && c < -tolerance);
}

}  // namespace

std::vector<std::array<int, 2>> self_intersections(const Surface& surface, int limit) {
    std::vector<std::array<int, 2>> found;
    const TriangleTree tree(surface);
    const auto box = bounds(surface.vertices);
    const double size = (Eigen::Map<const Vector3d>(box[1].data()) - Eigen::Map<const Vector3d>(box[0].data())).norm();
    const double tolerance = 1e-14 * size * size * size;
    for (int i = 0; i < static_cast<int>(surface.triangles.size()) && static_cast<int>(found.size()) < limit; ++i) {
        const Vector3d a[3] = {tree.corner(i, 0), tree.corner(i, 1), tree.corner(i, 2)};
        const Vector3d low = a[0].cwiseMin(a[1]).cwiseMin(a[2]), high = a[0].cwiseMax(a[1]).cwiseMax(a[2]);
        tree.for_each_in_box(low, high, [&](int j) {
            if (j <= i || static_cast<int>(found.size()) >= limit) return;
            const Vector3d b[3] = {tree.corner(j, 0), tree.corner(j, 1), tree.corner(j, 2)};
            bool crossed = false;
            for (int k = 0; k < 3 && !crossed; ++k)
                crossed = segment_crosses(a[k], a[(k + 1) % 3], b, tolerance) ||
                          segment_crosses(b[k], b[(k + 1) % 3], a, tolerance);
            if (crossed) found.push_back({i, j});
        });
    }
    return found;
}

}  // namespace palpate
