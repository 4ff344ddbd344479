#include "meshes/finger_shape.h"

#include <cmath>
#include <cstdio>
#include <numbers>

#include "meshes/input_error.h"
#include "meshes/plain_numbers.h"
#include "meshes/smoothstep.h"

namespace palpate {

std::vector<std::string> FingerShape::validate() const {
    std::vector<std::string> wrong;
    auto need = [&](double value, const shape_bounds::Bounds& bounds, const char* what, double in, const char* unit) {
        if (value >= bounds.low && value <= bounds.high) return;
        char text[120];
        plain_snprintf(text, sizeof text, "the %s must be between %g and %g%s", what, in * bounds.low, in * bounds.high,
                       unit);
        wrong.emplace_back(text);
    };
    need(length, shape_bounds::length, "length", 1e3, " mm");
    need(width, shape_bounds::width, "width", 1e3, " mm");
    need(thickness, shape_bounds::thickness, "thickness", 1e3, " mm");
    need(pad_bulge, shape_bounds::pad_bulge, "pad bulge", 1, "");
    need(nail_drop, shape_bounds::nail_drop, "nail drop", 1, "");
    need(crease, shape_bounds::crease, "crease", 1, "");
    return wrong;
}

FingerShape finger_shape(const std::string& finger) {
    if (finger == "thumb") return {.length = 0.030, .width = 0.0205, .thickness = 0.0160};
    if (finger == "index") return {.length = 0.025, .width = 0.0170, .thickness = 0.0140};
    if (finger == "middle") return {.length = 0.026, .width = 0.0175, .thickness = 0.0145};
    if (finger == "ring") return {.length = 0.0255, .width = 0.0165, .thickness = 0.0135};
    if (finger == "little") return {.length = 0.023, .width = 0.0148, .thickness = 0.0120};
    throw InputError("unknown finger '" + finger + "'; expected thumb, index, middle, ring or little");
}

std::vector<std::string> finger_shape_names() { return {"thumb", "index", "middle", "ring", "little"}; }

namespace {

/// Share of the full section left at s in [0, 1] where the end closes over the last `closing` of the length.
double closing_profile(double s, double closing) {
    const double u = std::max(0.0, (s - 1 + closing) / closing);
    return std::sqrt(std::max(0.0, 1 - std::pow(u, 2.2)));
}

/// Height of the tip, and of the widest place of the section at s.
double tip_height(const FingerShape& f) { return 0.30 * 0.46 * f.thickness * (1 - f.nail_drop); }
double side_height(const FingerShape& f, double s) { return tip_height(f) * (1 - closing_profile(s, 0.45)); }

/// What the bulge and the crease, which takes the last 30 % of the length before the cut, make of the height of the pad
/// side at s.
double pad_height(const FingerShape& f, double s) {
    const double swelling = 1 + f.pad_bulge * std::exp(-std::pow((s - 0.6) / 0.28, 2));
    return f.crease > 0 ? swelling * (1 - f.crease * smoothstep((0.3 - s) / 0.3)) : swelling;
}

/// Point of the section at s, at angle phi (0 = radial side, pi/2 = dorsal).
Point section_point(const FingerShape& f, double s, double phi) {
    const double half_dorsal = 0.46 * f.thickness, half_palmar = 0.54 * f.thickness;
    const double tip = tip_height(f), side = side_height(f, s);
    const double drop = 1 - f.nail_drop * smoothstep((s - 0.35) / 0.65);
    const double top = tip + (half_dorsal * drop - tip) * closing_profile(s, 0.20);
    const double bottom = tip + (-half_palmar - tip) * closing_profile(s, 0.62);
    const double c = std::cos(phi), n = std::sin(phi);
    // Superellipse: fuller over the nail (2.5) than at the pad (2.15).
    const double exponent = n > 0 ? 2.5 : 2.15;
    const double reach = std::pow(std::pow(std::abs(c), exponent) + std::pow(std::abs(n), exponent), -1 / exponent);
    const double half_width = 0.5 * f.width * closing_profile(s, 0.45);
    const double height = n > 0 ? top - side : (side - bottom) * pad_height(f, s);
    return {(s - 0.5) * f.length, half_width * reach * c, side + height * reach * n};
}

}  // namespace

void change_pad(std::vector<Point>& nodes, const FingerShape& f, const FingerShape& wanted) {
    if (wanted.pad_bulge == f.pad_bulge && wanted.crease == f.crease) return;
    for (Point& p : nodes) {
        const double s = p[0] / f.length + 0.5, side = side_height(f, std::min(1.0, std::max(0.0, s)));
        if (p[2] < side) p[2] = side + (p[2] - side) * pad_height(wanted, s) / pad_height(f, s);
    }
}

Surface finger_surface(const FingerShape& shape) {
    if (const auto wrong = shape.validate(); !wrong.empty()) throw InputError(wrong);
    constexpr int rings = 48, around = 48;
    Surface s;
    // Rings crowd towards the tip, where the section closes fast.
    for (int i = 0; i < rings; ++i) {
        const double t = double(i) / rings, along = 1 - (1 - t) * (1 - t) * (0.6 + 0.4 * (1 - t));
        for (int j = 0; j < around; ++j)
            s.vertices.push_back(section_point(shape, along, 2 * std::numbers::pi * j / around));
    }
    const int tip = int(s.vertices.size()), cap = tip + 1;
    s.vertices.push_back(section_point(shape, 1, 0));
    s.vertices.push_back({-0.5 * shape.length, 0, 0});
    auto id = [&](int i, int j) { return i * around + j % around; };
    for (int j = 0; j < around; ++j) {
        for (int i = 0; i + 1 < rings; ++i) {
            s.triangles.push_back({id(i, j), id(i + 1, j), id(i + 1, j + 1)});
            s.triangles.push_back({id(i, j), id(i + 1, j + 1), id(i, j + 1)});
        }
        s.triangles.push_back({id(rings - 1, j), tip, id(rings - 1, j + 1)});
        s.triangles.push_back({cap, id(0, j), id(0, j + 1)});
    }
    if (volume(s) < 0)
        for (auto& t : s.triangles) std::swap(t[1], t[2]);
    return s;
}

}  // namespace palpate
