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

/// The same for a piece of skin whose outward normal is `outward` (object's frame): where it lies on a face, or no
/// deeper in it than a solve leaves it, and looks at it, that face is the way out (a strict side), and not another one
/// that happens to be nearer. What slides from one object onto another that lies flush with it would else hang at the
/// face between the two, which is none of what they are together.
inline int side_of_skin(const Shape& shape, const Vec3<double>& x, const Vec3<double>& outward, int before,
                        double travel) {
    const int strict = 3, known = before < -strict ? before + strict : before > strict ? before - strict : before;
    const int side = side_in_step(shape, x, known, travel);
    int axis = 2;
    if (shape.kind == ShapeKind::box)
        for (int i = 0; i < 2; ++i)
            if (std::abs(outward[i]) > std::abs(outward[axis])) axis = i;
    const double towards = outward[axis] < 0 ? 1 : -1;
    const int face = int(towards) * (axis + 1);
    if (side != 0 && side != face) return side;
    const double half = shape.kind == ShapeKind::cylinder ? shape.size.y : shape.size[axis];
    const bool looks = std::abs(outward[axis]) > fitted::looks_at_face, on = towards * x[axis] > half - fitted::on_face;
    return looks && on ? face + int(towards) * strict : side;
}

}  // namespace palpate
