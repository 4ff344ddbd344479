#pragma once
// Bounding volume hierarchy over the triangles of a surface.

#include <Eigen/Core>

#include "meshes/surface.h"

namespace palpate {

class TriangleTree {
  public:
    explicit TriangleTree(const Surface& surface);

    /// Nearest point on the surface.
    Eigen::Vector3d nearest(const Eigen::Vector3d& x) const;
    /// The triangle that has it; -1 where there is none.
    int nearest_triangle(const Eigen::Vector3d& x) const;

    /// Calls visit(triangle) for every triangle whose box meets [low, high].
    template <class Visit>
    void for_each_in_box(const Eigen::Vector3d& low, const Eigen::Vector3d& high, Visit visit) const {
        descend(0, low, high, visit);
    }

    const Surface& surface() const { return surface_; }
    Eigen::Vector3d corner(int triangle, int k) const {
        return Eigen::Map<const Eigen::Vector3d>(surface_.vertices[surface_.triangles[triangle][k]].data());
    }

  private:
    struct Node {
        Eigen::Vector3d low, high;
        int left = -1, right = -1;  ///< children; a leaf has none
        int begin = 0, end = 0;     ///< range of order_ in a leaf
    };
    int build(int begin, int end);
    struct Found {
        double squared_distance;
        Eigen::Vector3d point;
        int triangle;
    };
    Found find(const Eigen::Vector3d& x) const;
    void nearest_below(int node, const Eigen::Vector3d& x, Found& best) const;
    template <class Visit>
    void descend(int n, const Eigen::Vector3d& low, const Eigen::Vector3d& high, Visit& visit) const {
        const Node& node = nodes_[n];
        if ((node.low.array() > high.array()).any() || (node.high.array() < low.array()).any()) return;
        if (node.left < 0) {
            for (int i = node.begin; i < node.end; ++i) visit(order_[i]);
            return;
        }
        descend(node.left, low, high, visit);
        descend(node.right, low, high, visit);
    }

    Surface surface_;
    std::vector<int> order_;
    std::vector<Node> nodes_;
};

/// Nearest point of the triangle (a, b, c) to x.
Eigen::Vector3d nearest_on_triangle(const Eigen::Vector3d& x, const Eigen::Vector3d& a, const Eigen::Vector3d& b,
                                    const Eigen::Vector3d& c);

/// Up to `limit` pairs of triangles that cross each other.
std::vector<std::array<int, 2>> self_intersections(const Surface& surface, int limit);

}  // namespace palpate
