#include "scenes/picture/raster.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

namespace palpate {

namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

double smooth(double low, double high, double x) {
    const double t = std::clamp((x - low) / (high - low), 0.0, 1.0);
    return t * t * (3 - 2 * t);
}

Colour mixed(Colour a, Colour b, double t) {
    Colour c;
    for (std::size_t d = 0; d < 3; ++d) c[d] = float((1 - t) * a[d] + t * b[d]);
    return c;
}
Colour scaled(Colour a, double s) {
    for (float& x : a) x = float(std::clamp(x * s, 0.0, 1.0));
    return a;
}

/// Sky, ground and a sun over the viewer's left shoulder; outlines darker, so that shapes stand off each other.
Colour shaded(Colour colour, const Vector3d& normal_in_view, const Vector3d& up_in_view) {
    const double sky = 0.5 + 0.5 * normal_in_view.dot(up_in_view);
    const double sun = std::max(0.0, normal_in_view.dot(Vector3d(-0.45, 0.62, 0.64)));
    const double outline = smooth(0.0, 0.45, std::abs(normal_in_view.z()));
    return scaled(colour, (0.50 + 0.22 * sky + 0.38 * sun) * (0.72 + 0.28 * outline));
}

}  // namespace

View::View(const Camera& c, int w, int h) : camera(c), width(w), height(h) {
    const Vector3d towards = (c.eye - c.target).normalized();
    Vector3d right = c.up.cross(towards);
    if (right.norm() < 1e-9) right = towards.unitOrthogonal();
    right.normalize();
    axes << right.transpose(), towards.cross(right).transpose(), towards.transpose();
}

Vector3d View::in_view(const Vector3d& world) const { return axes * (world - camera.eye); }

Vector3d View::pixel(const Vector3d& v) const {
    if (camera.field <= 0) {
        const double scale = 0.5 * height / camera.half_height;
        return {0.5 * width + scale * v.x(), 0.5 * height - scale * v.y(), v.z()};
    }
    const double away = std::max(1e-4, -v.z()), scale = 0.5 * height / std::tan(0.5 * camera.field) / away;
    return {0.5 * width + scale * v.x(), 0.5 * height - scale * v.y(), 1 / away};
}

std::array<Vector3d, 2> View::ray(double x, double y) const {
    const double u = (x - 0.5 * width) / (0.5 * height), v = (0.5 * height - y) / (0.5 * height);
    if (camera.field <= 0) {
        const Vector3d at(u * camera.half_height, v * camera.half_height, 0);
        return {camera.eye + axes.transpose() * at, -axes.row(2).transpose()};
    }
    const double t = std::tan(0.5 * camera.field);
    return {camera.eye, (axes.transpose() * Vector3d(u * t, v * t, -1)).normalized()};
}

Raster::Raster(const Camera& camera, int width, int height, Colour background)
    : view_(camera, width, height),
      background_(background),
      pixels_(std::size_t(width * height), {background, -1e30f}),
      layer_depth_(pixels_.size(), -1e30f),
      opacity_(pixels_.size(), 0.0f),
      layer_colour_(pixels_.size()),
      ids_(pixels_.size(), -1) {}

/// Calls paint(pixel, depth, triangle's corners in view, weights) where a triangle is.
template <class Paint>
void Raster::draw(const Triangles& t, Paint paint) {
    std::vector<Vector3d> at, seen;
    for (const Vertex& v : t.vertices)
        seen.push_back(view_.in_view(v.position)), at.push_back(view_.pixel(seen.back()));
    for (const auto& f : t.faces) {
        const std::array<std::size_t, 3> c{std::size_t(f[0]), std::size_t(f[1]), std::size_t(f[2])};
        if (view_.camera.field > 0 && (seen[c[0]].z() > -2e-3 || seen[c[1]].z() > -2e-3 || seen[c[2]].z() > -2e-3))
            continue;
        const Vector3d &a = at[c[0]], &b = at[c[1]], &d = at[c[2]];
        const double area = (b.x() - a.x()) * (d.y() - a.y()) - (b.y() - a.y()) * (d.x() - a.x());
        if (std::abs(area) < 1e-9) continue;
        const int x0 = std::max(0, int(std::floor(std::min({a.x(), b.x(), d.x()})))),
                  x1 = std::min(view_.width - 1, int(std::ceil(std::max({a.x(), b.x(), d.x()})))),
                  y0 = std::max(0, int(std::floor(std::min({a.y(), b.y(), d.y()})))),
                  y1 = std::min(view_.height - 1, int(std::ceil(std::max({a.y(), b.y(), d.y()}))));
        for (int y = y0; y <= y1; ++y)
            for (int x = x0; x <= x1; ++x) {
                const double px = x + 0.5, py = y + 0.5;
                const double wb = ((px - a.x()) * (d.y() - a.y()) - (py - a.y()) * (d.x() - a.x())) / area,
                             wd = ((b.x() - a.x()) * (py - a.y()) - (b.y() - a.y()) * (px - a.x())) / area;
                const double wa = 1 - wb - wd;
                if (wa < 0 || wb < 0 || wd < 0) continue;
                const double depth = wa * a.z() + wb * b.z() + wd * d.z();
                Vector3d w(wa, wb, wd);
                if (view_.camera.field > 0) w = Vector3d(wa * a.z(), wb * b.z(), wd * d.z()) / depth;
                paint(std::size_t(y * view_.width + x), depth, c, seen, w);
            }
    }
}

void Raster::opaque(const Triangles& t) {
    const Vector3d up = view_.axes.col(2);
    draw(t, [&](std::size_t p, double depth, const auto& c, const auto&, const Vector3d& w) {
        if (float(depth) <= pixels_[p].depth) return;
        const Vertex &a = t.vertices[c[0]], &b = t.vertices[c[1]], &d = t.vertices[c[2]];
        Vector3d n = view_.axes * (w[0] * a.normal + w[1] * b.normal + w[2] * d.normal).normalized();
        if (n.z() < 0 && n.z() > -0.2) n.z() = 0;  // a smooth normal behind the outline
        if (n.z() < 0) n = -n;
        Colour colour;
        for (std::size_t k = 0; k < 3; ++k)
            colour[k] = float(w[0] * a.colour[k] + w[1] * b.colour[k] + w[2] * d.colour[k]);
        pixels_[p] = {shaded(colour, n, up), float(depth)};
    });
}

void Raster::layer(const Triangles& t, int id, double opacity, const Contacts& contacts) {
    const Vector3d up = view_.axes.col(2);
    std::vector<Vector3d> kept;
    for (const Vector3d& x : contacts.place) kept.push_back(view_.in_view(x));
    draw(t, [&](std::size_t p, double depth, const auto& c, const auto& seen, const Vector3d& w) {
        if (float(depth) <= pixels_[p].depth || float(depth) <= layer_depth_[p]) return;
        const Vertex &a = t.vertices[c[0]], &b = t.vertices[c[1]], &d = t.vertices[c[2]];
        const Vector3d at = w[0] * seen[c[0]] + w[1] * seen[c[1]] + w[2] * seen[c[2]];
        Vector3d n = view_.axes * (w[0] * a.normal + w[1] * b.normal + w[2] * d.normal).normalized();
        if (n.z() < 0) n = -n;
        double clear = 0;
        for (const Vector3d& x : kept) {
            const Vector3d along = view_.camera.field > 0 ? Vector3d(x.normalized()) : Vector3d(0, 0, -1);
            if (along.dot(x - at) < 0.0005) continue;  // it is nearer than this surface
            const double beside = (at - x - along.dot(at - x) * along).norm();
            clear = std::max(clear, 1 - smooth(0.65 * contacts.radius, contacts.radius, beside));
        }
        layer_depth_[p] = float(depth);
        layer_colour_[p] = shaded(a.colour, n, up);
        opacity_[p] = float(opacity * (1 - 0.8 * clear));
        ids_[p] = id;
    });
}

void Raster::line(const Vector3d& a, const Vector3d& b, Colour colour, double thickness, bool hidden) {
    const Vector3d va = view_.in_view(a), vb = view_.in_view(b);
    if (view_.camera.field > 0 && (va.z() > -2e-3 || vb.z() > -2e-3)) return;
    const Vector3d pa = view_.pixel(va), pb = view_.pixel(vb);
    const double length = (pb - pa).head<2>().norm(), half = 0.5 * thickness;
    const int count = std::max(1, int(2 * length));
    for (int k = 0; k <= count; ++k) {
        const Vector3d at = pa + double(k) / count * (pb - pa);
        for (int y = int(std::floor(at.y() - half)); y <= int(at.y() + half); ++y)
            for (int x = int(std::floor(at.x() - half)); x <= int(at.x() + half); ++x) {
                if (x < 0 || y < 0 || x >= view_.width || y >= view_.height) continue;
                if ((Vector2d(x + 0.5, y + 0.5) - at.head<2>()).norm() > half + 0.3) continue;
                const auto p = std::size_t(y * view_.width + x);
                const float near = float(at.z() + (view_.camera.field > 0 ? 0.004 * at.z() : 1e-4));
                if (hidden && (near < pixels_[p].depth || near < layer_depth_[p])) continue;
                if (!hidden) layer_depth_[p] = -1e30f, opacity_[p] = 0;
                pixels_[p] = {colour, std::max(pixels_[p].depth, float(at.z()))};
                if (hidden) opacity_[p] = 0;
            }
    }
}

void Raster::floor(double height, const std::vector<const Triangles*>& shadow, Colour colour, Colour lines) {
    // Shadows: what stands over each cell of the floor, seen along the light, blurred.
    constexpr int cells = 320;
    constexpr double cell = 0.0016;
    const Vector3d light = Vector3d(0.16, -0.10, 1).normalized();
    std::vector<float> dark(std::size_t(cells * cells), 0.0f), blurred(dark.size());
    const Vector2d low = view_.camera.target.head<2>() - 0.5 * cells * cell * Vector2d::Ones();
    for (const Triangles* t : shadow)
        for (const auto& f : t->faces) {
            Vector2d c[3];
            bool above = true;
            for (std::size_t k = 0; k < 3; ++k) {
                const Vector3d& x = t->vertices[std::size_t(f[k])].position;
                above = above && x.z() > height - 0.002;
                c[k] = (x - (x.z() - height) / light.z() * light).head<2>() - low;
            }
            const double area = (c[1] - c[0]).x() * (c[2] - c[0]).y() - (c[1] - c[0]).y() * (c[2] - c[0]).x();
            if (!above || std::abs(area) < 1e-14) continue;
            auto cell_of = [&](double v) { return std::clamp(int(v / cell), 0, cells - 1); };
            for (int j = cell_of(std::min({c[0].y(), c[1].y(), c[2].y()}));
                 j <= cell_of(std::max({c[0].y(), c[1].y(), c[2].y()})); ++j)
                for (int i = cell_of(std::min({c[0].x(), c[1].x(), c[2].x()}));
                     i <= cell_of(std::max({c[0].x(), c[1].x(), c[2].x()})); ++i) {
                    const Vector2d x = cell * Vector2d(i + 0.5, j + 0.5) - c[0];
                    const Vector2d u = c[1] - c[0], v = c[2] - c[0];
                    const double wu = (x.x() * v.y() - x.y() * v.x()) / area,
                                 wv = (u.x() * x.y() - u.y() * x.x()) / area;
                    if (wu >= -0.2 && wv >= -0.2 && wu + wv <= 1.2) dark[std::size_t(j * cells + i)] = 1;
                }
        }
    for (int pass = 0; pass < 6; ++pass) {
        const int step = pass % 2 ? cells : 1;
        for (int k = 0; k < cells * cells; ++k) {
            float sum = 0;
            for (int d = -3; d <= 3; ++d) {
                const int other = k + d * step;
                if (other >= 0 && other < cells * cells) sum += dark[std::size_t(other)];
            }
            blurred[std::size_t(k)] = sum / 7;
        }
        dark.swap(blurred);
    }
    for (int y = 0; y < view_.height; ++y)
        for (int x = 0; x < view_.width; ++x) {
            const auto [from, along] = view_.ray(x + 0.5, y + 0.5);
            if (along.z() * (height - from.z()) <= 0) continue;
            const double t = (height - from.z()) / along.z();
            const Vector3d at = from + t * along, v = view_.in_view(at);
            const double depth = view_.camera.field > 0 ? 1 / std::max(1e-4, -v.z()) : v.z();
            Pixel& p = pixels_[std::size_t(y * view_.width + x)];
            if (float(depth) <= p.depth) continue;
            const double far = (at.head<2>() - view_.camera.target.head<2>()).norm();
            const double there = 1 - smooth(0.10, 0.24, far);
            if (there <= 0) continue;
            auto to_line = [](double c) { return std::abs(c - 0.01 * std::round(c / 0.01)); };
            const double wide = 0.00022 + 0.0004 * t;
            const double on_line = 1 - smooth(0.3 * wide, wide, std::min(to_line(at.x()), to_line(at.y())));
            Colour c = mixed(colour, lines, 0.55 * on_line);
            const int i = int((at.x() - low.x()) / cell), j = int((at.y() - low.y()) / cell);
            if (i >= 0 && j >= 0 && i < cells && j < cells) c = scaled(c, 1 - 0.42 * dark[std::size_t(j * cells + i)]);
            p = {mixed(background_, c, there), float(depth)};
        }
}

Image Raster::image(int factor) const {
    Image out(view_.width / factor, view_.height / factor, background_);
    for (int y = 0; y < out.height; ++y)
        for (int x = 0; x < out.width; ++x) {
            Colour sum{0, 0, 0};
            for (int j = 0; j < factor; ++j)
                for (int i = 0; i < factor; ++i) {
                    const auto p = std::size_t((y * factor + j) * view_.width + x * factor + i);
                    const Colour c = mixed(pixels_[p].colour, layer_colour_[p], opacity_[p]);
                    for (std::size_t d = 0; d < 3; ++d) sum[d] += c[d] / float(factor * factor);
                }
            out.set(x, y, sum);
        }
    return out;
}

}  // namespace palpate
