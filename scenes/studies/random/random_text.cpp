#include "scenes/studies/random/random_text.h"

#include <algorithm>
#include <array>
#include <cstdarg>
#include <cstdio>
#include <map>
#include <vector>

#include "meshes/plain_numbers.h"

namespace palpate {

std::string line(const char* format, ...) {
    char buffer[240];
    va_list arguments;
    va_start(arguments, format);
    plain_vsnprintf(buffer, sizeof buffer, format, arguments);
    va_end(arguments);
    return buffer;
}

std::string lumpy_ball(Random& r) {
    const double radius = r.between(8, 14), lumps = r.between(0, 0.15), stretch = r.between(0.6, 1.4);
    std::vector<std::array<double, 3>> points;
    std::vector<std::array<int, 3>> faces;
    for (int i = 0; i < 12; ++i) {  // an icosahedron: cyclic permutations of (0, 1, golden ratio)
        const double one = i & 1 ? -1 : 1, golden = i & 2 ? -1.618033988749895 : 1.618033988749895;
        std::array<double, 3> p{};
        p[std::size_t(i / 4 + 1) % 3] = one, p[std::size_t(i / 4 + 2) % 3] = golden;
        points.push_back(p);
    }
    auto apart2 = [&](int a, int b) {
        double sum = 0;
        for (std::size_t d = 0; d < 3; ++d) sum += std::pow(points[std::size_t(a)][d] - points[std::size_t(b)][d], 2);
        return sum;
    };
    auto outward = [&](std::array<int, 3> f) {
        const auto &a = points[std::size_t(f[0])], &b = points[std::size_t(f[1])], &c = points[std::size_t(f[2])];
        const double volume = a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) +
                              a[2] * (b[0] * c[1] - b[1] * c[0]);
        return volume > 0 ? f : std::array{f[0], f[2], f[1]};
    };
    for (int a = 0; a < 12; ++a)
        for (int b = a + 1; b < 12; ++b)
            for (int c = b + 1; c < 12; ++c)
                if (apart2(a, b) < 4.1 && apart2(b, c) < 4.1 && apart2(c, a) < 4.1) faces.push_back(outward({a, b, c}));
    std::map<std::pair<int, int>, int> middle;
    auto between = [&](int a, int b) {
        const auto [at, fresh] = middle.emplace(std::minmax(a, b), int(points.size()));
        if (fresh) {
            std::array<double, 3> p;
            for (std::size_t d = 0; d < 3; ++d) p[d] = 0.5 * (points[std::size_t(a)][d] + points[std::size_t(b)][d]);
            points.push_back(p);
        }
        return at->second;
    };
    std::string text;
    std::string triangles;
    for (const auto& f : faces) {
        const int m[3] = {between(f[0], f[1]), between(f[1], f[2]), between(f[2], f[0])};
        for (const auto& t : {std::array{f[0], m[0], m[2]}, std::array{m[0], f[1], m[1]}, std::array{m[2], m[1], f[2]},
                              std::array{m[0], m[1], m[2]}})
            triangles += line("f %d %d %d\n", t[0] + 1, t[1] + 1, t[2] + 1);
    }
    for (const auto& p : points) {
        const double length = std::sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]);
        const double reach = radius * (1 - lumps * r.between(0, 1)) / length;
        text += line("v %.4f %.4f %.4f\n", reach * p[0], reach * stretch * p[1], reach * p[2]);
    }
    return text + triangles;
}

}  // namespace palpate
