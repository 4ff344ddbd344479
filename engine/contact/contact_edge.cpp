#include "engine/contact/contact_edge.h"

#include <algorithm>
#include <cmath>

#include "engine/contact/fitted.h"

namespace palpate {

namespace {

/// Roots s of (1 - s)^3 = square s between 0 and 1, of which the left falls and the right rises: the difference is
/// convex, so that Newton's steps rise to the root. Many at once do not wait for each other. Squares from 0 to `far`.
constexpr double far = 1e30;  // the root is 1e-30
void find_reaches(int count, const double* square, double* reach) {
    for (int i = 0; i < count; ++i) {
        const double k = square[i], w = std::cbrt(std::min(k, 1.0));
        reach[i] = k < 1 ? 1 - w * (1 - w / 3) : 1 / (3 + k);
    }
    double longest = 1;
    for (int iteration = 0; iteration < 50 && longest > 1e-12; ++iteration) {
        longest = 0;
        for (int i = 0; i < count; ++i) {
            const double left = 1 - reach[i], f = left * left * left - square[i] * reach[i];
            const double step = f / (3 * left * left + square[i] + 1e-300);
            reach[i] += step;
            longest = std::max(longest, std::abs(step));
        }
    }
    for (int i = 0; i < count; ++i) reach[i] = std::clamp(reach[i], 0.0, 1.0);
}

}  // namespace

double reach_along_edge(double pressure, double gap, double length, double modulus) {
    if (!(pressure > 0)) return 0;
    if (!(gap > 0)) return 1;
    if (!(length > 0)) return 1;
    // With s in units of the length: (1 - s)^(3/2) = c sqrt(s).
    const double c = fitted::nodal_gap * 0.75 * modulus * gap / (pressure * length), square = c * c;
    if (!std::isfinite(square)) return 0;
    double reach;
    const double asked = std::min(square, far);
    find_reaches(1, &asked, &reach);
    return reach;
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

namespace {

/// Twice the area of a face, as it is deformed [m^2].
double twice_area(const ContactSurface& c, const std::array<int, 3>& face) {
    const Vec3<double>& a = c.position[std::size_t(face[0])];
    return norm(cross(c.position[std::size_t(face[1])] - a, c.position[std::size_t(face[2])] - a));
}

/// What reach_along_edge() squares, from a sample that touches to one that does not, at most `far`.
double edge_square(const ContactSurface& c, std::size_t touching, std::size_t free) {
    const Vec3<double>&force = c.pressing[touching], along = c.position[free] - c.position[touching];
    const double bears = dot(force, force) * dot(along, along);
    const double gives = fitted::nodal_gap * 0.75 * c.modulus * c.gap[free] * c.area[touching];
    if (!(dot(force, force) > 0)) return far;
    return bears > 0 && c.gap[free] > 0 ? std::min(gives * gives / bears, far) : 0;
}

/// Faces across which contact ends; their edges are asked together (find_reaches).
struct CrossedFaces {
    static constexpr int room = 32;
    int count = 0;
    bool corner[room];  ///< one sample touches; else two do
    double area[room];  ///< twice that of the whole face [m^2]
    double square[2 * room], reach[2 * room];
};

/// Twice the area in contact of these faces [m^2]: a corner's part is what both edges cut off.
double area_of(CrossedFaces& c) {
    find_reaches(2 * c.count, c.square, c.reach);
    double sum = 0;
    for (int i = 0; i < c.count; ++i) {
        const double a = c.reach[2 * i], b = c.reach[2 * i + 1];
        sum += c.area[i] * (c.corner[i] ? a * b : 1 - (1 - a) * (1 - b));
    }
    c.count = 0;
    return sum;
}

}  // namespace

double area_in_contact(const ContactSurface& surface) {
    if (surface.faces.empty()) {
        double area = 0;
        for (std::size_t s = 0; s < surface.touches.size(); ++s) area += surface.touches[s] ? surface.area[s] : 0;
        return area;
    }
    double twice = 0;
    CrossedFaces crossed;
    for (const std::array<int, 3>& f : surface.faces) {
        const auto touches = [&](std::size_t k) { return int(surface.touches[std::size_t(f[k])]); };
        const int touching = touches(0) + touches(1) + touches(2);
        if (touching == 0) continue;
        const double area = twice_area(surface, f);
        if (touching == 3) {
            twice += area;
            continue;
        }
        const bool corner = touching == 1;
        std::size_t odd = 0;  // the one that touches, or does not, alone
        while (touches(odd) != int(corner)) ++odd;
        const int i = crossed.count++;
        crossed.corner[i] = corner, crossed.area[i] = area;
        for (std::size_t k = 0; k < 2; ++k) {
            const auto alone = std::size_t(f[odd]), other = std::size_t(f[(odd + 1 + k) % 3]);
            crossed.square[2 * i + int(k)] =
                corner ? edge_square(surface, alone, other) : edge_square(surface, other, alone);
        }
        if (crossed.count == CrossedFaces::room) twice += area_of(crossed);
    }
    return 0.5 * (twice + area_of(crossed));
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
