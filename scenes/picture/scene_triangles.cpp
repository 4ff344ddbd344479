#include "scenes/picture/scene_triangles.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>

namespace palpate {

namespace {

using Eigen::Vector3d;

Vector3d as_eigen(const Point& p) { return {p[0], p[1], p[2]}; }

/// Unit normals by area.
std::vector<Vector3d> normals_of(const std::vector<Vector3d>& x, const std::vector<std::array<int, 3>>& faces) {
    std::vector<Vector3d> normal(x.size(), Vector3d::Zero());
    for (const auto& f : faces) {
        const auto [a, b, c] = std::array{std::size_t(f[0]), std::size_t(f[1]), std::size_t(f[2])};
        const Vector3d n = (x[b] - x[a]).cross(x[c] - x[a]);
        for (const std::size_t k : {a, b, c}) normal[k] += n;
    }
    for (Vector3d& n : normal) n.normalize();
    return normal;
}

void add_face(Triangles& t, const std::array<Vector3d, 3>& x, const std::array<Vector3d, 3>& n, Colour colour) {
    const int first = int(t.vertices.size());
    for (std::size_t k = 0; k < 3; ++k) t.vertices.push_back({x[k], n[k], colour});
    t.faces.push_back({first, first + 1, first + 2});
}
void add_quad(Triangles& t, const std::array<Vector3d, 4>& x, const std::array<Vector3d, 4>& n, Colour colour) {
    add_face(t, {x[0], x[1], x[2]}, {n[0], n[1], n[2]}, colour);
    add_face(t, {x[0], x[2], x[3]}, {n[0], n[2], n[3]}, colour);
}

/// A round bar between two points, `radius` at both, without ends where `open`.
void add_bar(Triangles& t, const Vector3d& a, const Vector3d& b, double ra, double rb, Colour colour) {
    const Vector3d axis = b - a;
    if (axis.norm() < 1e-6) return;
    const Vector3d z = axis.normalized(), x = z.unitOrthogonal(), y = z.cross(x);
    constexpr int around = 12;
    for (int k = 0; k < around; ++k) {
        std::array<Vector3d, 2> side;
        for (int d = 0; d < 2; ++d) {
            const double phi = 2 * std::numbers::pi * (k + d) / around;
            side[std::size_t(d)] = std::cos(phi) * x + std::sin(phi) * y;
        }
        add_quad(t, {a + ra * side[0], a + ra * side[1], b + rb * side[1], b + rb * side[0]},
                 {side[0], side[1], side[1], side[0]}, colour);
        add_face(t, {a, a + ra * side[0], a + ra * side[1]}, {-z, -z, -z}, colour);
        add_face(t, {b, b + rb * side[0], b + rb * side[1]}, {z, z, z}, colour);
    }
}

/// Points (radius, height) turned about z; `sharp` keeps the profile's corners.
void add_revolution(Triangles& t, const Pose<double>& pose, const std::vector<std::array<double, 2>>& profile,
                    Colour colour) {
    constexpr int around = 48;
    auto place = [&](double r, double z, double phi) {
        return as_eigen(transform(pose, Vec3<double>{r * std::cos(phi), r * std::sin(phi), z}));
    };
    const Vector3d origin = as_eigen(pose.position);
    for (std::size_t k = 0; k + 1 < profile.size(); ++k) {
        const auto [r0, z0] = profile[k];
        const auto [r1, z1] = profile[k + 1];
        const double length = std::hypot(r1 - r0, z1 - z0), nr = (z1 - z0) / length, nz = -(r1 - r0) / length;
        for (int j = 0; j < around; ++j) {
            const double p0 = 2 * std::numbers::pi * j / around, p1 = 2 * std::numbers::pi * (j + 1) / around;
            const Vector3d n0 = place(nr, nz, p0) - origin, n1 = place(nr, nz, p1) - origin;
            add_quad(t, {place(r0, z0, p0), place(r0, z0, p1), place(r1, z1, p1), place(r1, z1, p0)}, {n0, n1, n1, n0},
                     colour);
        }
    }
}

/// Skin nodes that press into an object that gives way: how deep, and where.
void dent(const World& world, const VirtualObject& o, Triangles& t) {
    if (!(o.stiffness > 0)) return;
    std::vector<Vector3d> skin;
    for (const ContactSurface& c : world.contact_surfaces)
        for (std::size_t k = 0; k < c.position.size(); ++k)
            if (c.touches[k]) skin.push_back(as_eigen(transform(c.bone, c.position[k])));
    for (Vertex& v : t.vertices) {
        // The surface is moved inwards, along its normal, to the skin that lies inside of it nearby.
        double deepest = 0;
        for (const Vector3d& x : skin) {
            const Vector3d offset = x - v.position;
            const double depth = -offset.dot(v.normal), beside = (offset + depth * v.normal).norm();
            deepest = std::max(deepest, depth * std::exp(-0.5 * beside * beside / (0.002 * 0.002)));
        }
        v.position -= deepest * v.normal;
    }
}

std::vector<double> pressures_of(const TetMesh& mesh, const ContactSurface& contact) {
    std::vector<double> pressure(mesh.nodes.size(), 0.0);
    for (std::size_t s = 0; s < mesh.pad_nodes.size(); ++s)
        pressure[std::size_t(mesh.pad_nodes[s])] = pressure_on(contact, s);
    return pressure;
}

/// An object of tissue as it is deformed; pressure shows on its own colour. Faces that meet at an edge do not share
/// their normals.
Triangles soft_triangles(const World& world, const SoftObject& o, Colour colour, double most) {
    std::vector<Vector3d> x;
    for (const Point& p : soft_positions(world, o)) x.push_back(as_eigen(p));
    const std::vector<Vector3d> normal = normals_of(x, o.skin.mesh.surface);
    const std::vector<double> pressure = pressures_of(o.skin.mesh, o.surface);
    Triangles t;
    for (const auto& f : o.skin.mesh.surface) {
        const std::array<std::size_t, 3> c{std::size_t(f[0]), std::size_t(f[1]), std::size_t(f[2])};
        const Vector3d flat = (x[c[1]] - x[c[0]]).cross(x[c[2]] - x[c[0]]).normalized();
        const int first = int(t.vertices.size());
        for (const std::size_t k : c) {
            const double share = std::min(1.0, pressure[k] / most);
            const Colour pressed = skin_colour(share);
            const float mixed = float(std::min(1.0, 4 * share));
            Colour shown;
            for (std::size_t d = 0; d < 3; ++d) shown[d] = colour[d] + mixed * (pressed[d] - colour[d]);
            t.vertices.push_back({x[k], normal[k].dot(flat) > 0.8 ? normal[k] : flat, shown});
        }
        t.faces.push_back({first, first + 1, first + 2});
    }
    return t;
}

}  // namespace

std::vector<double> node_pressures(const World& world, EntityId finger) {
    return pressures_of(world.skins.find(finger)->mesh, *world.contact_surfaces.find(finger));
}

bool centre_of_pressure(const World& world, EntityId finger, Vector3d& place, Vector3d& force) {
    const ContactSurface& c = *world.contact_surfaces.find(finger);
    double weight = 0;
    place.setZero(), force.setZero();
    for (std::size_t s = 0; s < c.force.size(); ++s) {
        const double w = norm(c.pressing[s]);
        place += w * as_eigen(transform(c.bone, c.position[s]));
        force += as_eigen(c.force[s]);
        weight += w;
    }
    if (weight < 1e-3) return false;
    place /= weight;
    return true;
}

Triangles finger_triangles(const World& world, EntityId finger, double most, bool in_bone_frame) {
    constexpr int rows = 3;
    constexpr double towards_tangents = 0.75;
    const TetMesh& mesh = world.skins.find(finger)->mesh;
    const Pose<double> bone = bone_pose(world, finger);
    std::vector<Vector3d> x;
    for (const Point& p : finger_positions(world, finger)) {
        const Vec3<double> here{p[0], p[1], p[2]};
        x.push_back(as_eigen(in_bone_frame ? inverse_transform(bone, here) : here));
    }
    const std::vector<Vector3d> normal = normals_of(x, mesh.surface);
    const std::vector<double> pressure = node_pressures(world, finger);
    Triangles t;
    for (const auto& f : mesh.surface) {
        const std::array<std::size_t, 3> c{std::size_t(f[0]), std::size_t(f[1]), std::size_t(f[2])};
        std::map<std::array<int, 2>, int> number;
        for (int i = 0; i <= rows; ++i)
            for (int j = 0; i + j <= rows; ++j) {
                const double w[3] = {1 - double(i + j) / rows, double(i) / rows, double(j) / rows};
                Vector3d flat = Vector3d::Zero(), n = Vector3d::Zero();
                double p = 0;
                for (std::size_t k = 0; k < 3; ++k)
                    flat += w[k] * x[c[k]], n += w[k] * normal[c[k]], p += w[k] * pressure[c[k]];
                Vector3d round = flat;
                for (std::size_t k = 0; k < 3; ++k)
                    round -= towards_tangents * w[k] * (flat - x[c[k]]).dot(normal[c[k]]) * normal[c[k]];
                number[{i, j}] = int(t.vertices.size());
                t.vertices.push_back({round, n.normalized(), skin_colour(p / most)});
            }
        for (int i = 0; i < rows; ++i)
            for (int j = 0; i + j < rows; ++j) {
                t.faces.push_back({number[{i, j}], number[{i + 1, j}], number[{i, j + 1}]});
                if (i + j + 1 < rows)
                    t.faces.push_back({number[{i + 1, j}], number[{i + 1, j + 1}], number[{i, j + 1}]});
            }
    }
    return t;
}

Triangles object_triangles(const World& world, const VirtualObject& o, Colour colour, double most) {
    if (o.soft >= 0) return soft_triangles(world, world.soft.all[std::size_t(o.soft)], colour, most);
    const Vec3<double>& s = o.shape.size;
    Triangles t;
    std::vector<std::array<double, 2>> profile;
    auto place = [&](const Vec3<double>& x) { return as_eigen(transform(o.pose, x)); };
    switch (o.shape.kind) {
        case ShapeKind::plane:
            return t;
        case ShapeKind::box:
            for (int axis = 0; axis < 3; ++axis)
                for (const double side : {-1.0, 1.0}) {
                    Vec3<double> n{0, 0, 0};
                    n[axis] = side;
                    const Vector3d normal = place(n) - as_eigen(o.pose.position);
                    constexpr int parts = 12;  // small enough for a dent
                    auto corner = [&](int i, int j) {
                        Vec3<double> c;
                        c[axis] = side, c[(axis + 1) % 3] = 2.0 * i / parts - 1,
                        c[(axis + 2) % 3] = 2.0 * j / parts - 1;
                        return place({c.x * s.x, c.y * s.y, c.z * s.z});
                    };
                    for (int i = 0; i < parts; ++i)
                        for (int j = 0; j < parts; ++j)
                            add_quad(t, {corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1)},
                                     {normal, normal, normal, normal}, colour);
                }
            break;
        case ShapeKind::sphere:
        case ShapeKind::capsule:
            for (int i = 0; i <= 36; ++i) {
                const double phi = std::numbers::pi * (i / 36.0 - 0.5), shift = o.shape.kind == ShapeKind::sphere ? 0
                                                                                : i <= 18                         ? -s.y
                                                                                                                  : s.y;
                profile.push_back({s.x * std::cos(phi), s.x * std::sin(phi) + shift});
            }
            add_revolution(t, o.pose, profile, colour);
            if (o.shape.kind == ShapeKind::sphere)
                for (Vertex& v : t.vertices) v.normal = (v.position - as_eigen(o.pose.position)).normalized();
            break;
        case ShapeKind::cylinder:
            add_revolution(t, o.pose, {{0, -s.y}, {s.x, -s.y}, {s.x, s.y}, {0, s.y}}, colour);
            break;
        case ShapeKind::mesh: {
            std::vector<Vector3d> x;
            for (const Point& p : o.mesh->surface.vertices) x.push_back(place({p[0], p[1], p[2]}));
            const std::vector<Vector3d> normal = normals_of(x, o.mesh->surface.triangles);
            for (std::size_t k = 0; k < x.size(); ++k) t.vertices.push_back({x[k], normal[k], colour});
            t.faces.assign(o.mesh->surface.triangles.begin(), o.mesh->surface.triangles.end());
            break;
        }
    }
    dent(world, o, t);
    return t;
}

std::vector<Vector3d> sharp_edges(const Triangles& t, double angle_deg) {
    auto key = [&](int v) {
        std::array<long, 3> k;
        for (int d = 0; d < 3; ++d) k[std::size_t(d)] = std::lround(1e6 * t.vertices[std::size_t(v)].position[d]);
        return k;
    };
    std::map<std::array<std::array<long, 3>, 2>, Vector3d> first;
    std::vector<Vector3d> out;
    for (const auto& f : t.faces) {
        const Vector3d a = t.vertices[std::size_t(f[0])].position, b = t.vertices[std::size_t(f[1])].position,
                       c = t.vertices[std::size_t(f[2])].position;
        const Vector3d n = (b - a).cross(c - a);
        if (n.norm() < 1e-14) continue;
        for (std::size_t k = 0; k < 3; ++k) {
            std::array<std::array<long, 3>, 2> edge{key(f[k]), key(f[(k + 1) % 3])};
            if (edge[1] < edge[0]) std::swap(edge[0], edge[1]);
            const auto [found, fresh] = first.insert({edge, n.normalized()});
            if (fresh || found->second.dot(n.normalized()) > std::cos(angle_deg * std::numbers::pi / 180)) continue;
            out.push_back(t.vertices[std::size_t(f[k])].position);
            out.push_back(t.vertices[std::size_t(f[(k + 1) % 3])].position);
        }
    }
    return out;
}

Triangles hand_triangles(const HandParts& parts, const HandBones& bones, Colour colour) {
    const Surface skin = posed_skin(parts, bones);
    std::vector<Vector3d> x;
    for (const Point& p : skin.vertices) x.push_back(as_eigen(p));
    const std::vector<Vector3d> normal = normals_of(x, skin.triangles);
    Triangles t;
    for (std::size_t k = 0; k < x.size(); ++k) t.vertices.push_back({x[k], normal[k], colour});
    t.faces = skin.triangles;
    return t;
}

Triangles thimble_triangles(const World& world, const Matching& m) {
    const Colour frame{0.36f, 0.42f, 0.47f}, crank{0.88f, 0.53f, 0.10f}, link{0.25f, 0.30f, 0.35f},
        disk{0.18f, 0.62f, 0.27f};
    const Pose<double> bone = bone_pose(world, m.finger);
    auto place = [&](const Vector3d& device) {
        const Vector3d x = m.model.mount * device;
        return as_eigen(transform(bone, Vec3<double>{x.x(), x.y(), x.z()}));
    };
    Triangles t;
    const Skeleton lines = m.model.kind->skeleton(m.model, m.result.w);
    for (std::size_t l = 0; l < lines.size(); ++l)
        for (std::size_t k = 0; k + 1 < lines[l].size(); ++k) {
            const bool is_frame = l < 2 && lines.size() > 2 && lines[l].size() > 2;
            const bool is_crank = !is_frame && lines[l].size() > 2 && k == 0;  // what the servo turns
            const double radius = is_crank ? 0.0010 : is_frame ? 0.0009 : 0.0006;
            const Vector3d a = place(lines[l][k]), b = place(lines[l][k + 1]);
            add_bar(t, a, b, radius, radius, is_frame ? frame : is_crank ? crank : link);
            if (is_crank) {  // its servo: a short drum across the crank at its seat
                const Vector3d next = lines[l].size() > 2 ? place(lines[l][2]) : b;
                Vector3d across = (b - a).cross(next - b);
                if (across.norm() > 1e-12) {
                    across *= 0.0026 / across.norm();
                    add_bar(t, a - across, a + across, 0.0021, 0.0021, frame);
                }
            }
        }
    // The platform as a ring with spokes: one sees the pad through it.
    const Platform p = m.model.kind->platform(m.model, m.result.w);
    constexpr int around = 28;
    auto rim = [&](int k) {
        const double phi = 2 * std::numbers::pi * k / around;
        return place(p.centre + m.model.disk_radius * (p.rotation * Vector3d(std::cos(phi), std::sin(phi), 0)));
    };
    for (int k = 0; k < around; ++k) add_bar(t, rim(k), rim(k + 1), 0.0008, 0.0008, disk);
    for (int k = 0; k < 3; ++k) add_bar(t, place(p.centre), rim(k * around / 3), 0.0003, 0.0003, disk);
    return t;
}

Triangles arrow_triangles(const Vector3d& from, const Vector3d& to, double radius, Colour colour) {
    Triangles t;
    const Vector3d axis = to - from;
    const double length = axis.norm();
    if (length < 1e-6) return t;
    const double head = std::min(0.5 * length, 5 * radius);
    const Vector3d neck = to - head / length * axis;
    add_bar(t, from, neck, radius, radius, colour);
    add_bar(t, neck, to, 2.4 * radius, 0, colour);
    return t;
}

}  // namespace palpate
