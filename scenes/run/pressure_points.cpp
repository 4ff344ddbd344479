#include "scenes/run/pressure_points.h"

namespace palpate {

namespace {

Vec3<double> place_of(const PressedPad& pad, int face, const std::array<double, 3>& share) {
    Vec3<double> x{0, 0, 0};
    for (std::size_t k = 0; k < 3; ++k) x += share[k] * pad.place[std::size_t(pad.faces[std::size_t(face)][k])];
    return x;
}

/// Calls visit(face, shares of its samples, area) at points all over the parts of a pad's faces that are in contact.
template <class Visit>
void sample_pressed(const PressedPad& pad, Visit visit) {
    constexpr int n = 4;  // points on a lattice, at the centres of n^2 equal triangles of which those upright are taken
    for (const PressedTriangle& t : pad.pressed) {
        std::array<Vec3<double>, 3> x;
        for (std::size_t c = 0; c < 3; ++c) x[c] = place_of(pad, t.face, t.corner[c]);
        const double each = 0.5 * norm(cross(x[1] - x[0], x[2] - x[0])) / (n * (n + 1) / 2);
        for (int i = 0; i < n; ++i)
            for (int j = 0; i + j < n; ++j) {
                const double weight[3] = {(i + 1.0 / 3) / n, (j + 1.0 / 3) / n, 1 - (i + j + 2.0 / 3) / n};
                std::array<double, 3> share{0, 0, 0};
                for (std::size_t c = 0; c < 3; ++c)
                    for (std::size_t k = 0; k < 3; ++k) share[k] += weight[c] * t.corner[c][k];
                visit(t.face, share, each);
            }
    }
}

}  // namespace

PressedPad pressed_pad(const ContactSurface& c) {
    PressedPad out{c.force, c.position, {c.faces.begin(), c.faces.end()}, {}};
    for (int face = 0; face < int(c.faces.size()); ++face) {
        const PressedFace pressed = pressed_part(c, face);
        out.pressed.insert(out.pressed.end(), pressed.part.begin(), pressed.part.begin() + pressed.count);
    }
    return out;
}

std::vector<PressurePoint> pressure_points(const PressedPad& pad) {
    std::vector<PressurePoint> out;
    std::vector<double> around(pad.field.size(), 0.0);
    sample_pressed(pad, [&](int face, const std::array<double, 3>& share, double area) {
        for (std::size_t k = 0; k < 3; ++k) around[std::size_t(pad.faces[std::size_t(face)][k])] += share[k] * area;
    });
    sample_pressed(pad, [&](int face, const std::array<double, 3>& share, double area) {
        Vec3<double> force{0, 0, 0};
        for (std::size_t k = 0; k < 3; ++k) {
            const auto s = std::size_t(pad.faces[std::size_t(face)][k]);
            if (around[s] > 0) force += (share[k] * area / around[s]) * pad.field[s];
        }
        out.push_back({place_of(pad, face, share), force});
    });
    for (std::size_t s = 0; s < pad.field.size(); ++s)
        if (!(around[s] > 0) && dot(pad.field[s], pad.field[s]) > 0) out.push_back({pad.place[s], pad.field[s]});
    return out;
}

}  // namespace palpate
