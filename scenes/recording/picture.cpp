// The scene as a picture: an orthographic view from above the fingertips, painted back to front.

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <sstream>

#include "meshes/mesh_files.h"
#include "scenes/recording/results.h"

namespace palpate {

namespace {

using Eigen::Vector3d;

struct Polygon {
    std::vector<Vector3d> corners;  ///< view space: x right, y up, z towards the viewer [mm]
    std::string fill, stroke;
    double depth = 0;
};

Vector3d as_eigen(const Vec3<double>& v) { return {v.x, v.y, v.z}; }

class Painter {
  public:
    Painter() {
        // From the front right and below: that is where pads touch. Planes are drawn as glass.
        const Vector3d towards = Vector3d(0.62, -0.72, -0.62).normalized();
        const Vector3d right = Vector3d::UnitZ().cross(towards).normalized();
        view_ << right.transpose(), towards.cross(right).transpose(), towards.transpose();
    }

    void add(const std::vector<Vector3d>& world, const std::string& fill, const std::string& stroke,
             bool grows = true) {
        Polygon p{{}, fill, stroke, 0};
        for (const Vector3d& x : world) {
            p.corners.push_back(view_ * (1e3 * x));
            p.depth += p.corners.back().z() / double(world.size());
            if (!grows) continue;
            low_ = low_.cwiseMin(p.corners.back().head<2>());
            high_ = high_.cwiseMax(p.corners.back().head<2>());
        }
        polygons_.push_back(std::move(p));
    }
    /// Share of light on a face with this normal.
    double light(const Vector3d& normal) const {
        return 0.55 + 0.45 * std::max(0.0, (view_ * normal).dot(Vector3d(-0.3, 0.6, 0.74)));
    }
    bool faces_viewer(const Vector3d& normal) const { return (view_ * normal).z() > 0; }

    std::string svg(const std::string& title, double scale_max) {
        std::stable_sort(polygons_.begin(), polygons_.end(),
                         [](const Polygon& a, const Polygon& b) { return a.depth < b.depth; });
        const double margin = 0.06 * (high_ - low_).maxCoeff() + 2, width = 900,
                     scale = width / (high_.x() - low_.x() + 2 * margin);
        const double height = std::max(240.0, scale * (high_.y() - low_.y() + 2 * margin));
        std::ostringstream out;
        out.precision(5);
        out << "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 " << width << " " << height << "\" width=\""
            << width << "\" height=\"" << height
            << "\" font-family=\"sans-serif\" font-size=\"13\">\n<rect width=\"100%\" height=\"100%\" "
               "fill=\"white\"/>\n";
        for (const Polygon& p : polygons_) {
            out << "<path d=\"";
            for (std::size_t i = 0; i < p.corners.size(); ++i)
                out << (i ? "L" : "M") << scale * (p.corners[i].x() - low_.x() + margin) << " "
                    << height - scale * (p.corners[i].y() - low_.y() + margin);
            out << "Z\" fill=\"" << p.fill << "\" stroke=\"" << p.stroke
                << "\" stroke-width=\"0.6\" stroke-linejoin=\"round\"/>\n";
        }
        out << "<text x=\"14\" y=\"24\" font-size=\"15\" font-weight=\"bold\">" << title << "</text>\n";
        for (int i = 0; i < 60; ++i)
            out << "<rect x=\"" << 14 + 3 * i << "\" y=\"38\" width=\"3.2\" height=\"12\" fill=\""
                << skin_colour(i / 59.0, 1) << "\"/>\n";
        out << "<text x=\"14\" y=\"66\">0</text><text x=\"194\" y=\"66\" text-anchor=\"end\">" << std::round(scale_max)
            << " kPa contact pressure</text>\n";
        out << "<path d=\"M" << width - 24 - 10 * scale << " " << height - 22 << "h" << 10 * scale
            << "\" stroke=\"#111\" stroke-width=\"2\"/><text x=\"" << width - 24 << "\" y=\"" << height - 30
            << "\" text-anchor=\"end\">10 mm</text>\n</svg>\n";
        return out.str();
    }

    /// From skin to deep red with pressure (0..1), darkened by light (0..1).
    static std::string skin_colour(double t, double light) {
        t = std::clamp(t, 0.0, 1.0);
        const double r = 236 + t * (150 - 236), g = 196 + t * (12 - 196), b = 172 + t * (38 - 172);
        char text[8];
        std::snprintf(text, sizeof text, "#%02x%02x%02x", int(r * light), int(g * light), int(b * light));
        return text;
    }

  private:
    Eigen::Matrix3d view_;
    std::vector<Polygon> polygons_;
    Eigen::Vector2d low_{1e300, 1e300}, high_{-1e300, -1e300};
};

void paint_finger(Painter& painter, const World& world, EntityId finger, double scale_max) {
    const TetMesh& mesh = world.skins.find(finger)->mesh;
    const ContactSurface& contact = *world.contact_surfaces.find(finger);
    const std::vector<Point> now = finger_positions(world, finger);
    std::vector<double> pressure(now.size(), 0.0);
    for (std::size_t s = 0; s < mesh.pad_nodes.size(); ++s)
        pressure[mesh.pad_nodes[s]] = 1e-3 * norm(contact.force[s]) / contact.area[s];
    for (const auto& t : mesh.surface) {
        std::vector<Vector3d> corners;
        for (int i : t) corners.emplace_back(now[i][0], now[i][1], now[i][2]);
        const Vector3d normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalized();
        if (!painter.faces_viewer(normal)) continue;
        const double p = (pressure[t[0]] + pressure[t[1]] + pressure[t[2]]) / 3;
        painter.add(corners, Painter::skin_colour(p / scale_max, painter.light(normal)), "#00000030");
    }
}

/// Lines of a surface of revolution about z: profile points (radius, height), turned around.
void paint_revolution(Painter& painter, const Pose<double>& pose, const std::vector<std::array<double, 2>>& profile) {
    constexpr int around = 32;
    for (std::size_t k = 0; k + 1 < profile.size(); ++k)
        for (int j = 0; j < around; ++j) {
            std::vector<Vector3d> corners;
            for (auto [row, column] : {std::pair{k, j}, {k, j + 1}, {k + 1, j + 1}, {k + 1, j}}) {
                const double phi = 2 * std::numbers::pi * column / around;
                const auto [r, z] = profile[row];
                corners.push_back(as_eigen(transform(pose, Vec3<double>{r * std::cos(phi), r * std::sin(phi), z})));
            }
            const Vector3d normal = (corners[2] - corners[0]).cross(corners[3] - corners[1]).normalized();
            if (painter.faces_viewer(normal)) painter.add(corners, "#7fb0d84c", "#3a6ea540");
        }
}

void paint_object(Painter& painter, const RigidShape& o, const Vector3d& middle) {
    const Vec3<double>& s = o.shape.size;
    auto place = [&](double x, double y, double z) { return as_eigen(transform(o.pose, Vec3<double>{x, y, z})); };
    std::vector<std::array<double, 2>> profile;
    switch (o.shape.kind) {
        case ShapeKind::plane: {
            const Vector3d centre =
                as_eigen(inverse_transform(o.pose, Vec3<double>{middle.x(), middle.y(), middle.z()}));
            for (int i = -6; i < 6; ++i)  // tiles, so that they sort among the fingers
                for (int j = -6; j < 6; ++j) {
                    const double x = centre.x() + 0.01 * i, y = centre.y() + 0.01 * j;
                    painter.add(
                        {place(x, y, 0), place(x + 0.01, y, 0), place(x + 0.01, y + 0.01, 0), place(x, y + 0.01, 0)},
                        "#dfe7ee10", "#b9c7d3", false);
                }
            return;
        }
        case ShapeKind::box:
            for (int axis = 0; axis < 3; ++axis)
                for (double side : {-1.0, 1.0}) {
                    std::vector<Vector3d> corners;
                    for (auto [u, v] : {std::pair{-1, -1}, {1, -1}, {1, 1}, {-1, 1}}) {
                        Vec3<double> c;
                        c[axis] = side, c[(axis + 1) % 3] = u, c[(axis + 2) % 3] = v;
                        corners.push_back(place(c.x * s.x, c.y * s.y, c.z * s.z));
                    }
                    Vector3d normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]) * side;
                    if (painter.faces_viewer(normal.normalized()))
                        painter.add(corners, "#7fb0d84c", "#3a6ea5", s.x < 0.06 && s.y < 0.06);
                }
            return;
        case ShapeKind::sphere:
        case ShapeKind::capsule:
            for (int i = 0; i <= 24; ++i) {
                const double phi = std::numbers::pi * (i / 24.0 - 0.5), shift = o.shape.kind == ShapeKind::sphere ? 0
                                                                                : i < 12                          ? -s.y
                                                                                                                  : s.y;
                profile.push_back({s.x * std::cos(phi), s.x * std::sin(phi) + shift});
            }
            break;
        case ShapeKind::cylinder:
            profile = {{0, -s.y}, {s.x, -s.y}, {s.x, s.y}, {0, s.y}};
            break;
        case ShapeKind::mesh:
            for (const DistanceMesh::Triangle& t : o.mesh->triangles) {
                std::vector<Vector3d> corners;
                for (const Vec3<double>& p : {t.corner, t.corner + t.to_second, t.corner + t.to_third})
                    corners.push_back(place(p.x, p.y, p.z));
                const Vector3d normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalized();
                if (painter.faces_viewer(normal)) painter.add(corners, "#7fb0d84c", "#3a6ea520");
            }
            return;
    }
    paint_revolution(painter, o.pose, profile);
}

/// The platform as the thimble stands (configuration of the last match).
void paint_platform(Painter& painter, const World& world, const Matching& m) {
    const Platform p = m.model.kind->platform(m.model, m.result.w);
    const Pose<double> bone = bone_pose(world, m.finger);
    std::vector<Vector3d> rim;
    for (int j = 0; j < 32; ++j) {
        const double phi = 2 * std::numbers::pi * j / 32;
        const Vector3d x =
            m.model.mount * (p.centre + m.model.disk_radius * (p.rotation * Vector3d(std::cos(phi), std::sin(phi), 0)));
        rim.push_back(as_eigen(transform(bone, Vec3<double>{x.x(), x.y(), x.z()})));
    }
    painter.add(rim, "#2f9e4430", "#1b7a33");
}

}  // namespace

void write_picture(const std::filesystem::path& path, const Simulation& s) {
    double scale_max = 1;
    Vector3d middle = Vector3d::Zero();
    for (const EntityId finger : s.fingers) {
        const ContactSurface& c = *s.world.contact_surfaces.find(finger);
        for (std::size_t k = 0; k < c.force.size(); ++k)
            scale_max = std::max(scale_max, 1e-3 * norm(c.force[k]) / c.area[k]);
        middle += as_eigen(bone_pose(s.world, finger).position) / double(s.fingers.size());
    }
    Painter painter;
    for (const RigidShape& o : s.world.shapes) paint_object(painter, o, middle);
    for (const EntityId finger : s.fingers) paint_finger(painter, s.world, finger, scale_max);
    for (const Matching& m : s.world.matchings) paint_platform(painter, s.world, m);
    char title[200];
    std::snprintf(title, sizeof title, "%s, t = %.2f s (platforms green, objects blue)", s.scene.title.c_str(),
                  s.world.time);
    write_file(path, painter.svg(title, scale_max));
}

}  // namespace palpate
