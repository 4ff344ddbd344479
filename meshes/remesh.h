#pragma once
// Remeshing of a closed surface.

#include <functional>
#include <memory>

#include "meshes/triangle_tree.h"

namespace palpate {

/// Wanted edge length at a place [m].
using SizeField = std::function<double(const Eigen::Vector3d&)>;

/// Remeshes one surface, to as many sizes as are tried: split, collapse, flip, smooth, project (Botsch & Kobbelt 2004).
/// Edges grow round by round; the rounds that all sizes share are gone through once.
class Remesher {
  public:
    explicit Remesher(const TriangleTree& reference);  // which must outlive it
    ~Remesher();
    /// Triangles with edges near `edge_length` [m] whose vertices lie near the reference surface: by an offset that
    /// restores the volume.
    Surface operator()(double edge_length);
    /// The same with edges as long as the field says where they lie, and vertices on the reference surface: no offset.
    Surface operator()(const SizeField& size);

  private:
    struct Grown;
    std::unique_ptr<Grown> grown_;
};

/// To one size.
Surface remesh(const TriangleTree& reference, double edge_length);

}  // namespace palpate
