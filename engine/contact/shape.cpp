#include "engine/contact/shape.h"

#include <cmath>

namespace palpate {

int side_of(const Shape& shape, const Vec3<double>& x, int before) {
    if (!has_sides(shape.kind)) return 0;
    if (before != 0 && sided_point(shape.kind, shape.size, shape.round, x, double(before)).distance <= 0) return before;
    if (shape.kind == ShapeKind::cylinder) {  // its mantle is no side: what is beside it may go to either end
        const double over = std::abs(x.z) - shape.size.y;
        return over > std::hypot(x.x, x.y) - shape.size.x ? (x.z < 0 ? -3 : 3) : 0;
    }
    int axis = 0;
    for (int i = 1; i < 3; ++i)
        if (std::abs(x[i]) - shape.size[i] > std::abs(x[axis]) - shape.size[axis]) axis = i;
    return x[axis] < 0 ? -1 - axis : 1 + axis;
}

MeshPoint foot_point(const Shape& shape, const Vec3<double>& x, double side,
                     MeshPoint (*distance)(const DistanceMesh&, const Vec3<double>&)) {
    const double below = shape.foot - dot(shape.up, x);
    if (!(below > 0)) return distance(*shape.mesh, x);
    MeshPoint p = distance(*shape.mesh, x + below * shape.up);
    const double lean = side - std::floor(side);
    p.distance -= lean * below;
    p.normal -= (dot(p.normal, shape.up) - lean) * shape.up;
    return p;
}

}  // namespace palpate
