#include "scenes/run/finger_output.h"

#include <algorithm>
#include <cmath>

namespace palpate {

FingerOutput finger_output(const ContactSurface& c) {
    FingerOutput out;
    out.bone = c.bone;
    out.force = c.total;
    out.normal_force = c.normal_force;
    out.area = c.touching_area;
    out.touching = c.touching;
    double weight = 0;
    const Mat3<double> R = rotation_matrix(c.bone.rotation);
    for (std::size_t s = 0; s < c.force.size(); ++s) {
        const Vec3<double>& f = c.force[s];
        if (f.x == 0 && f.y == 0 && f.z == 0) continue;
        const Vec3<double> arm = R * c.position[s];
        const double size = norm(c.pressing[s]);
        out.torque += cross(arm, f);
        out.centre += size * arm;
        weight += size;
        out.pressure_peak = std::max(out.pressure_peak, pressure_on(c, s));
    }
    out.centre = weight > 0 ? c.bone.position + (1 / weight) * out.centre : Vec3<double>{NAN, NAN, NAN};
    return out;
}

}  // namespace palpate
