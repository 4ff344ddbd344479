#include "scenes/studies/random/finger_state.h"

#include <algorithm>
#include <cmath>
#include <map>

namespace palpate {

namespace {

/// Lumped: a quarter of each tetrahedron to each of its nodes. What lies wholly in the bone is the bone's.
std::vector<double> node_masses(const TetMesh& mesh, double density) {
    std::vector<double> mass(mesh.nodes.size(), 0.0);
    std::vector<bool> in_bone(mesh.nodes.size(), false);
    for (int node : mesh.bone_nodes) in_bone[std::size_t(node)] = true;
    auto at = [&](int i) {
        return Vec3<double>{mesh.nodes[std::size_t(i)][0], mesh.nodes[std::size_t(i)][1],
                            mesh.nodes[std::size_t(i)][2]};
    };
    for (const auto& t : mesh.tets) {
        if (std::all_of(t.begin(), t.end(), [&](int node) { return in_bone[std::size_t(node)]; })) continue;
        const Vec3<double> a = at(t[1]) - at(t[0]), b = at(t[2]) - at(t[0]), c = at(t[3]) - at(t[0]);
        for (int node : t) mass[std::size_t(node)] += density * std::abs(dot(a, cross(b, c))) / 24;
    }
    return mass;
}

/// Faces of one tetrahedron alone, seen from outside in the rest shape.
std::vector<std::array<int, 3>> outer_faces(const TetMesh& mesh) {
    std::map<std::array<int, 3>, std::array<int, 4>> once;  // face and the node across it
    for (const auto& t : mesh.tets)
        for (int k = 0; k < 4; ++k) {
            std::array<int, 3> face{t[std::size_t((k + 1) % 4)], t[std::size_t((k + 2) % 4)],
                                    t[std::size_t((k + 3) % 4)]};
            std::sort(face.begin(), face.end());
            if (!once.emplace(face, std::array{face[0], face[1], face[2], t[std::size_t(k)]}).second) once.erase(face);
        }
    auto at = [&](int i) {
        const Point& p = mesh.nodes[std::size_t(i)];
        return Vec3<double>{p[0], p[1], p[2]};
    };
    std::vector<std::array<int, 3>> faces;
    for (const auto& [key, f] : once) {
        const bool inward = dot(cross(at(f[1]) - at(f[0]), at(f[2]) - at(f[0])), at(f[3]) - at(f[0])) > 0;
        faces.push_back(inward ? std::array{f[0], f[2], f[1]} : std::array{f[0], f[1], f[2]});
    }
    return faces;
}

double distance_to_segment(const Vec3<double>& p, const Vec3<double>& a, const Vec3<double>& b) {
    const Vec3<double> ab = b - a;
    const double along = std::clamp(dot(p - a, ab) / std::max(dot(ab, ab), 1e-300), 0.0, 1.0);
    return norm(p - a - along * ab);
}

double distance_to_triangle(const Vec3<double>& p, const Vec3<double>& a, const Vec3<double>& b,
                            const Vec3<double>& c) {
    const Vec3<double> n = cross(b - a, c - a);
    const bool over =
        dot(cross(b - a, p - a), n) >= 0 && dot(cross(c - b, p - b), n) >= 0 && dot(cross(a - c, p - c), n) >= 0;
    if (over && dot(n, n) > 0) return std::abs(dot(p - a, n)) / norm(n);
    return std::min({distance_to_segment(p, a, b), distance_to_segment(p, b, c), distance_to_segment(p, c, a)});
}

}  // namespace

bool FingerState::finite() const {
    for (const Vec3<double>& x : position)
        if (!std::isfinite(dot(x, x))) return false;
    return std::isfinite(normal_force) && std::isfinite(dot(contact, contact));
}

Vec3<double> FingerState::momentum_rate(const FingerState& before, double dt) const {
    Vec3<double> rate{0, 0, 0};
    if (velocity.empty() || before.velocity.empty()) return rate;
    for (std::size_t i = 0; i < mass.size(); ++i) rate += (mass[i] / dt) * (velocity[i] - before.velocity[i]);
    return rate;
}

double FingerState::depth_under_skin(const Shape& shape, const Pose<double>& pose) const {
    constexpr double within = 4e-3, straight = 0.7;
    double deepest = 0;
    for (int node : skin->mesh.pad_nodes) {
        const Vec3<double>& x = position[std::size_t(node)];
        const SurfacePoint<double> s = surface_point(shape, pose, x);
        if (s.distance > within || s.distance < -1e-4) continue;  // inside an object: another law
        Vec3<double> outward{0, 0, 0};
        for (const auto& f : faces)
            if (f[0] == node || f[1] == node || f[2] == node) outward += area_vector(f);
        if (dot(s.normal, outward) <= straight * norm(outward)) continue;
        // Skin that is pressed in stands up beside what presses: behind such a wall, the object is outside again.
        const Vec3<double> nearest = x - s.distance * s.normal;
        if (in_tissue(nearest)) deepest = std::max(deepest, distance_to_skin(nearest));
    }
    return deepest;
}

bool FingerState::in_tissue(const Vec3<double>& p) const {
    auto at = [&](int i) -> const Vec3<double>& { return position[std::size_t(i)]; };
    return std::any_of(skin->mesh.tets.begin(), skin->mesh.tets.end(), [&](const auto& t) {
        auto volume = [&](const Vec3<double>& a, const Vec3<double>& b, const Vec3<double>& c, const Vec3<double>& d) {
            return dot(cross(b - a, c - a), d - a);
        };
        const double whole = volume(at(t[0]), at(t[1]), at(t[2]), at(t[3]));
        return whole > 0 && volume(p, at(t[1]), at(t[2]), at(t[3])) > 0 &&
               volume(at(t[0]), p, at(t[2]), at(t[3])) > 0 && volume(at(t[0]), at(t[1]), p, at(t[3])) > 0 &&
               volume(at(t[0]), at(t[1]), at(t[2]), p) > 0;
    });
}

double FingerState::distance_to_skin(const Vec3<double>& p) const {
    double least = HUGE_VAL;
    for (const auto& f : faces)
        least = std::min(least, distance_to_triangle(p, position[std::size_t(f[0])], position[std::size_t(f[1])],
                                                     position[std::size_t(f[2])]));
    return least;
}

double FingerState::longest_edge() const {
    double longest = 0;
    const auto& pad = skin->mesh.pad_nodes;
    auto in_pad = [&](int node) { return std::binary_search(pad.begin(), pad.end(), node); };
    auto at_rest = [&](int node) {
        const Point& p = skin->mesh.nodes[std::size_t(node)];
        return Vec3<double>{p[0], p[1], p[2]};
    };
    for (const auto& f : faces)
        for (std::size_t k = 0; k < 3; ++k)
            if (const int a = f[k], b = f[(k + 1) % 3]; in_pad(a) && in_pad(b))
                longest = std::max(longest, norm(at_rest(a) - at_rest(b)));
    return longest;
}

Vec3<double> FingerState::area_vector(const std::array<int, 3>& f) const {
    const Vec3<double>& a = position[std::size_t(f[0])];
    return cross(position[std::size_t(f[1])] - a, position[std::size_t(f[2])] - a);
}

std::vector<FingerState> finger_states(const Simulation& s, const std::vector<FingerState>& before) {
    std::vector<FingerState> all;
    for (std::size_t i = 0; i < s.fingers.size(); ++i) {
        FingerState f;
        f.skin = s.world.skins.find(s.fingers[i]);
        f.status = skin_status(s.world, s.fingers[i]);
        for (const Point& p : finger_positions(s.world, s.fingers[i])) f.position.push_back({p[0], p[1], p[2]});
        f.bone = bone_pose(s.world, s.fingers[i]);
        if (i < before.size()) {
            f.bone_velocity = (1 / s.world.solver.dt) * (f.bone.position - before[i].bone.position);
            f.bone_turn = f.bone.rotation * conjugate(before[i].bone.rotation);
            f.mass = before[i].mass;
            f.faces = before[i].faces;
            for (std::size_t k = 0; k < f.position.size(); ++k)
                f.velocity.push_back((1 / s.world.solver.dt) * (f.position[k] - before[i].position[k]));
        } else {
            f.mass = node_masses(f.skin->mesh, s.scene.spec.fingers[i].density);
            f.faces = outer_faces(f.skin->mesh);
        }
        const ContactSurface& c = *s.world.contact_surfaces.find(s.fingers[i]);
        f.contact = c.total;
        f.normal_force = c.normal_force;
        f.objects = c.objects;
        const std::vector<Vec3<double>> reactions = bone_reactions(s.world, s.fingers[i]);
        for (std::size_t k = 0; k < reactions.size(); ++k) {
            f.reaction += reactions[k];
            f.reaction_torque += cross(f.position[k] - f.bone.position, reactions[k]);
            f.solved |= dot(reactions[k], reactions[k]) > 0;
        }
        all.push_back(std::move(f));
    }
    return all;
}

}  // namespace palpate
