// How long tissue could stay linear: for how many steps element rotations of some step, carried along by the bone, give
// the forces of the real ones. An upper bound of what a level of detail with frozen rotations and stiffness could save:
// of a finger alone, and of all that touch at once, for fingers are solved side by side in SIMD lanes.

#include <benchmark/benchmark.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "scenes/simulation.h"

namespace palpate {
namespace {

/// One finger's elastic forces, as a program of its own: corotational tetrahedra with rotations from outside.
struct Tissue {
    const TetMesh* mesh = nullptr;
    double mu = 0, lambda = 0;
    std::vector<Eigen::Matrix3d> inverse_rest;
    std::vector<double> volume;

    Tissue(const TetMesh& m, double young, double poisson) : mesh(&m) {
        mu = young / (2 * (1 + poisson));
        lambda = young * poisson / ((1 + poisson) * (1 - 2 * poisson));
        for (const auto& tet : m.tets) {
            const Eigen::Matrix3d edges = edges_of(m.nodes, tet);
            inverse_rest.push_back(edges.inverse());
            volume.push_back(edges.determinant() / 6);
        }
    }
    static Eigen::Matrix3d edges_of(const std::vector<Point>& nodes, const std::array<int, 4>& tet) {
        Eigen::Matrix3d d;
        for (int k = 0; k < 3; ++k)
            for (int i = 0; i < 3; ++i)
                d(i, k) = nodes[std::size_t(tet[std::size_t(k + 1)])][std::size_t(i)] -
                          nodes[std::size_t(tet[0])][std::size_t(i)];
        return d;
    }
    std::vector<Eigen::Matrix3d> gradients(const std::vector<Point>& nodes) const {
        std::vector<Eigen::Matrix3d> all;
        for (std::size_t e = 0; e < inverse_rest.size(); ++e)
            all.push_back(edges_of(nodes, mesh->tets[e]) * inverse_rest[e]);
        return all;
    }
    std::vector<Eigen::Vector3d> forces(const std::vector<Eigen::Matrix3d>& gradient,
                                        const std::vector<Eigen::Matrix3d>& rotation) const {
        std::vector<Eigen::Vector3d> out(mesh->nodes.size(), Eigen::Vector3d::Zero());
        for (std::size_t e = 0; e < gradient.size(); ++e) {
            const Eigen::Matrix3d s = rotation[e].transpose() * gradient[e] - Eigen::Matrix3d::Identity();
            const Eigen::Matrix3d stress =
                rotation[e] * (mu * (s + s.transpose()) + lambda * s.trace() * Eigen::Matrix3d::Identity());
            const Eigen::Matrix3d on_nodes = -volume[e] * stress * inverse_rest[e].transpose();
            for (int k = 0; k < 3; ++k) {
                out[std::size_t(mesh->tets[e][std::size_t(k + 1)])] += on_nodes.col(k);
                out[std::size_t(mesh->tets[e][0])] -= on_nodes.col(k);
            }
        }
        return out;
    }
};

Eigen::Matrix3d rotation_of(const Eigen::Matrix3d& f) {
    const Eigen::JacobiSVD<Eigen::Matrix3d> svd(f, Eigen::ComputeFullU | Eigen::ComputeFullV);
    Eigen::Matrix3d u = svd.matrixU();
    if ((u * svd.matrixV().transpose()).determinant() < 0) u.col(2) = -u.col(2);
    return u * svd.matrixV().transpose();
}

/// range(0): scene; range(1): error allowed, in thousandths of the contact force.
void frozen_tissue(benchmark::State& state) {
    const char* names[] = {"hand", "recorded_hand", "press"};
    const std::string name = names[state.range(0)];
    const double allowed = 1e-3 * double(state.range(1));
    Simulation s =
        make_simulation(load_scene(PALPATE_SOURCE_DIR "/scenes/" + name + ".toml", {"solver.preset=balanced"}), 1);
    std::vector<Tissue> tissues;
    for (std::size_t i = 0; i < s.fingers.size(); ++i) {
        const FingerSpec& f = s.scene.spec.fingers[i];
        tissues.emplace_back(f.mesh, f.young_modulus, f.poisson_ratio);
    }
    std::vector<std::vector<Eigen::Matrix3d>> frozen(s.fingers.size());  // [finger][element], in its bone's frame
    double touching = 0, left_out = 0, steps = 0, all_left_out = 0;
    for (auto _ : state) {
        run(s, std::atomic<bool>(false), [&](const StepInputs&, double) {
            const double touching_before = touching, left_out_before = left_out;
            for (std::size_t i = 0; i < s.fingers.size(); ++i) {
                const ContactSurface& contact = *s.world.contact_surfaces.find(s.fingers[i]);
                double force = 0;
                for (const Vec3<double>& f : contact.force) force += norm(f);
                if (!(force > 0)) {
                    frozen[i].clear();
                    continue;
                }
                ++touching;
                const Tissue& tissue = tissues[i];
                const Eigen::Quaterniond q(contact.bone.rotation.w, contact.bone.rotation.x, contact.bone.rotation.y,
                                           contact.bone.rotation.z);
                const Eigen::Matrix3d bone = q.toRotationMatrix();
                const auto gradient = tissue.gradients(finger_positions(s.world, s.fingers[i]));
                std::vector<Eigen::Matrix3d> real, carried;
                for (const Eigen::Matrix3d& f : gradient) real.push_back(rotation_of(f));
                double error = HUGE_VAL;
                if (!frozen[i].empty()) {
                    for (const Eigen::Matrix3d& r : frozen[i]) carried.push_back(bone * r);
                    const auto a = tissue.forces(gradient, real), b = tissue.forces(gradient, carried);
                    error = 0;
                    for (std::size_t n = 0; n < a.size(); ++n) error += (a[n] - b[n]).norm();
                    error /= force;
                }
                if (error <= allowed) {
                    ++left_out;
                    continue;
                }
                frozen[i].clear();
                for (const Eigen::Matrix3d& r : real) frozen[i].push_back(bone.transpose() * r);
            }
            if (touching == touching_before) return;
            ++steps;
            all_left_out += touching - touching_before == left_out - left_out_before;
        });
    }
    state.counters["left_out"] = left_out / touching;
    state.counters["all_left_out"] = all_left_out / steps;
    state.SetLabel(name);
}
BENCHMARK(frozen_tissue)->ArgsProduct({{0, 1, 2}, {1, 10, 50}})->Iterations(1)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace palpate
