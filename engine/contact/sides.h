#pragma once
// When a point remembers the side of an object that it was on.

#include "engine/contact/fitted.h"
#include "engine/contact/shape.h"

namespace palpate {

/// The side (side_of) of a point that may move by `travel` [m] in this step, seen from the object; 0 where the object
/// is thick enough for the nearest face to be the right one. A body that turns between fingers must be free to leave
/// them.
inline int side_in_step(const Shape& shape, const Vec3<double>& x, int before, double travel) {
    const int side = side_of(shape, x, before);
    if (side == 0) return 0;
    const int axis = (side < 0 ? -side : side) - 1;
    const double half = shape.kind == ShapeKind::cylinder ? shape.size.y : shape.size[axis];
    return half > fitted::thin_half && travel < half ? 0 : side;
}

}  // namespace palpate
