#include "scenes/studies/random/random_mesh.h"

#include <cmath>
#include <map>
#include <numbers>

#include "scenes/studies/random/random_text.h"

namespace palpate {

std::string box_mesh(const std::array<double, 3>& size, int cuts) {
    std::string points, faces;
    std::map<std::array<int, 3>, int> known;  // faces share their edges' points
    auto point = [&](const std::array<int, 3>& at) {
        const auto [entry, fresh] = known.emplace(at, int(known.size()) + 1);
        if (fresh) {
            double x[3];
            for (std::size_t d = 0; d < 3; ++d) x[d] = size[d] * (double(at[d]) / cuts - 0.5);
            points += line("v %.4f %.4f %.4f\n", x[0], x[1], x[2]);
        }
        return entry->second;
    };
    for (std::size_t axis = 0; axis < 3; ++axis)
        for (const bool far : {false, true})
            for (int i = 0; i < cuts; ++i)
                for (int j = 0; j < cuts; ++j) {
                    auto corner = [&](int along, int across) {
                        std::array<int, 3> at{};
                        at[axis] = far ? cuts : 0;
                        at[(axis + 1) % 3] = i + along, at[(axis + 2) % 3] = j + across;
                        return point(at);
                    };
                    const int a = corner(0, 0), b = corner(1, 0), c = corner(1, 1), d = corner(0, 1);
                    faces += far ? line("f %d %d %d\nf %d %d %d\n", a, b, c, a, c, d)
                                 : line("f %d %d %d\nf %d %d %d\n", a, c, b, a, d, c);
                }
    return points + faces;
}

std::string prism_mesh(int sides, double radius, double height) {
    std::string points, faces;
    for (int i = 0; i < sides; ++i) {
        const double angle = 2 * std::numbers::pi * i / sides, x = radius * std::cos(angle),
                     y = radius * std::sin(angle);
        points += line("v %.4f %.4f %.4f\nv %.4f %.4f %.4f\n", x, y, -0.5 * height, x, y, 0.5 * height);
    }
    const int bottom = 2 * sides + 1, top = bottom + 1;
    points += line("v 0 0 %.4f\nv 0 0 %.4f\n", -0.5 * height, 0.5 * height);
    for (int i = 0; i < sides; ++i) {
        const int low = 2 * i + 1, high = low + 1, next_low = 2 * ((i + 1) % sides) + 1, next_high = next_low + 1;
        faces += line("f %d %d %d\nf %d %d %d\n", low, next_low, next_high, low, next_high, high);
        faces += line("f %d %d %d\nf %d %d %d\n", bottom, next_low, low, top, high, next_high);
    }
    return points + faces;
}

}  // namespace palpate
