#include "engine/contact/contact_edge.h"

#include <algorithm>
#include <cmath>

#include "engine/contact/fitted.h"

namespace palpate {

double reach_along_edge(double pressure, double gap, double length, double modulus) {
    if (!(pressure > 0)) return 0;
    if (!(gap > 0)) return 1;
    if (!(length > 0)) return 1;
    // With s in units of the length: (1 - s)^(3/2) = c sqrt(s), that is (1 - s)^3 = c^2 s, of which the left falls and
    // the right rises.
    const double c = fitted::nodal_gap * 0.75 * modulus * gap / (pressure * length), square = c * c;
    if (!std::isfinite(square)) return 0;
    double s = 1 / (3 + square);  // Newton from the left of the root: the difference is convex, so that it rises to it
    for (int i = 0; i < 50; ++i) {
        const double left = 1 - s, f = left * left * left - square * s;
        const double step = f / (3 * left * left + square);
        s += step;
        if (step < 1e-12) break;
    }
    return std::clamp(s, 0.0, 1.0);
}

Vec3<double> face_point(const ContactSurface& surface, int face, const std::array<double, 3>& share) {
    const auto& f = surface.faces[std::size_t(face)];
    Vec3<double> x{0, 0, 0};
    for (std::size_t k = 0; k < 3; ++k) x += share[k] * surface.position[std::size_t(f[k])];
    return x;
}

namespace {

/// Where contact ends between two corners of a face, as shares of its samples.
std::array<double, 3> edge_point(const ContactSurface& c, const std::array<int, 3>& face, std::size_t touching,
                                 std::size_t free) {
    const auto a = std::size_t(face[touching]), b = std::size_t(face[free]);
    const double reach =
        reach_along_edge(norm(c.pressing[a]) / c.area[a], c.gap[b], norm(c.position[b] - c.position[a]), c.modulus);
    std::array<double, 3> share{0, 0, 0};
    share[touching] = 1 - reach, share[free] = reach;
    return share;
}

}  // namespace

PressedFace pressed_part(const ContactSurface& surface, int face) {
    const auto& f = surface.faces[std::size_t(face)];
    PressedFace out;
    std::array<std::array<double, 3>, 4> corner;
    int corners = 0, ends = 0;
    for (std::size_t a = 0; a < 3; ++a) {
        const std::size_t b = (a + 1) % 3;
        const bool of_a = surface.touches[std::size_t(f[a])], of_b = surface.touches[std::size_t(f[b])];
        if (of_a) {
            corner[std::size_t(corners)] = {0, 0, 0};
            corner[std::size_t(corners++)][a] = 1;
        }
        if (of_a == of_b) continue;
        const std::array<double, 3> end = of_a ? edge_point(surface, f, a, b) : edge_point(surface, f, b, a);
        out.edge[std::size_t(ends++)] = corner[std::size_t(corners++)] = end;
    }
    out.has_edge = ends == 2;
    for (int k = 2; k < corners; ++k)
        out.part[std::size_t(out.count++)] = {face, {corner[0], corner[std::size_t(k - 1)], corner[std::size_t(k)]}};
    return out;
}

double area_in_contact(const ContactSurface& surface) {
    if (surface.faces.empty()) {
        double area = 0;
        for (std::size_t s = 0; s < surface.touches.size(); ++s) area += surface.touches[s] ? surface.area[s] : 0;
        return area;
    }
    double area = 0;
    for (int face = 0; face < int(surface.faces.size()); ++face) {
        const PressedFace pressed = pressed_part(surface, face);
        for (int k = 0; k < pressed.count; ++k) {
            const auto& corner = pressed.part[std::size_t(k)].corner;
            const Vec3<double> a = face_point(surface, face, corner[0]);
            area +=
                0.5 * norm(cross(face_point(surface, face, corner[1]) - a, face_point(surface, face, corner[2]) - a));
        }
    }
    return area;
}

std::vector<Vec3<double>> contact_outline(const ContactSurface& surface) {
    std::vector<Vec3<double>> out;
    for (int face = 0; face < int(surface.faces.size()); ++face) {
        const PressedFace pressed = pressed_part(surface, face);
        if (!pressed.has_edge) continue;
        for (const auto& end : pressed.edge) out.push_back(face_point(surface, face, end));
    }
    return out;
}

void mark_wanted_gaps(ContactSurface& surface) {
    std::fill(surface.gap.begin(), surface.gap.end(), 0.0);
    for (const auto& f : surface.faces) {
        const bool edge = surface.touches[std::size_t(f[0])] != surface.touches[std::size_t(f[1])] ||
                          surface.touches[std::size_t(f[1])] != surface.touches[std::size_t(f[2])];
        if (!edge) continue;
        for (int s : f)
            if (!surface.touches[std::size_t(s)]) surface.gap[std::size_t(s)] = -1;
    }
}

}  // namespace palpate
