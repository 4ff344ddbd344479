#include <cmath>

#include "devices/matching/matching.h"

namespace palpate {

namespace {

using Eigen::Vector3d;

/// A point in the disk's (radial, axial) half-plane.
struct Polar {
    Vector3d offset, radial;
    double height, rho;
};

Polar polar(const Vector3d& x, const Platform& p) {
    Polar s;
    s.offset = x - p.centre;
    s.height = s.offset.dot(p.normal);
    const Vector3d in_plane = s.offset - s.height * p.normal;
    s.rho = in_plane.norm();
    s.radial = s.rho > 1e-12 ? Vector3d(in_plane / s.rho) : Vector3d::Zero();
    return s;
}

/// Chain rule from (height, rho) to centre and normal:
/// dh = -n . dp + offset . dn, drho = -radial . dp - h radial . dn.
DiskDistance chain(const Polar& s, const Platform& p, double value, double dheight, double drho) {
    return {value, -dheight * p.normal - drho * s.radial, dheight * s.offset - drho * s.height * s.radial};
}

DiskDistance rim(const Polar& s, const Platform& p, double radius) {
    const double a = s.rho - radius, value = std::hypot(a, s.height);
    const double safe = value > 1e-15 ? value : 1;
    return chain(s, p, value, s.height / safe, a / safe);
}

}  // namespace

DiskDistance disk_distance(const Vector3d& x, const Platform& p, double radius) {
    const Polar s = polar(x, p);
    if (s.rho > radius) return rim(s, p, radius);
    return chain(s, p, std::abs(s.height), s.height < 0 ? -1 : 1, 0);
}

DiskDistance cone_distance(const Vector3d& x, const Platform& p, double radius) {
    const Polar s = polar(x, p);
    const double a = s.rho - radius;
    const double cone = (a + s.height) * std::sqrt(0.5);  // distance to the cone's side
    if (s.height >= a && a > 0) return rim(s, p, radius);
    // Outside beside the cone, or inside: the greater of the two half-plane distances.
    if (cone > s.height) return chain(s, p, cone, std::sqrt(0.5), std::sqrt(0.5));
    return chain(s, p, s.height, 1, 0);
}

}  // namespace palpate
