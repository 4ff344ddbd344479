#include "scenes/studies/random/finger_state.h"

#include <cmath>

namespace palpate {

namespace {

/// Lumped: a quarter of each tetrahedron to each of its nodes.
std::vector<double> node_masses(const TetMesh& mesh, double density) {
    std::vector<double> mass(mesh.nodes.size(), 0.0);
    auto at = [&](int i) {
        return Vec3<double>{mesh.nodes[std::size_t(i)][0], mesh.nodes[std::size_t(i)][1],
                            mesh.nodes[std::size_t(i)][2]};
    };
    for (const auto& t : mesh.tets) {
        const Vec3<double> a = at(t[1]) - at(t[0]), b = at(t[2]) - at(t[0]), c = at(t[3]) - at(t[0]);
        for (int node : t) mass[std::size_t(node)] += density * std::abs(dot(a, cross(b, c))) / 24;
    }
    return mass;
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

double FingerState::depth_of(const Shape& shape, const Pose<double>& pose) const {
    double deepest = 0;
    for (int node : skin->mesh.pad_nodes) {
        const Vec3<double>& x = position[std::size_t(node)];
        Vec3<double> bone = x;
        double nearest = 1e300;
        for (int k : skin->mesh.bone_nodes) {
            const Vec3<double> way = position[std::size_t(k)] - x;
            if (dot(way, way) < nearest) nearest = dot(way, way), bone = position[std::size_t(k)];
        }
        const double length = norm(bone - x);
        if (!(surface_point(shape, pose, x).distance < length)) continue;
        for (int k = 1; k <= 12; ++k) {
            const Vec3<double> inside = x + (k / 12.0) * (bone - x);
            if (surface_point(shape, pose, inside).distance < -1e-4) deepest = std::max(deepest, k / 12.0 * length);
        }
    }
    return deepest;
}

std::vector<FingerState> finger_states(const Simulation& s, const std::vector<FingerState>& before) {
    std::vector<FingerState> all;
    for (std::size_t i = 0; i < s.fingers.size(); ++i) {
        FingerState f;
        f.skin = s.world.skins.find(s.fingers[i]);
        f.status = skin_status(s.world, s.fingers[i]);
        for (const Point& p : finger_positions(s.world, s.fingers[i])) f.position.push_back({p[0], p[1], p[2]});
        f.mass = node_masses(f.skin->mesh, s.scene.spec.fingers[i].density);
        if (i < before.size())
            for (std::size_t k = 0; k < f.position.size(); ++k)
                f.velocity.push_back((1 / s.world.solver.dt) * (f.position[k] - before[i].position[k]));
        const ContactSurface& c = *s.world.contact_surfaces.find(s.fingers[i]);
        f.contact = c.total;
        f.normal_force = c.normal_force;
        for (const Vec3<double>& r : bone_reactions(s.world, s.fingers[i])) {
            f.reaction += r;
            f.solved |= dot(r, r) > 0;
        }
        all.push_back(std::move(f));
    }
    return all;
}

}  // namespace palpate
