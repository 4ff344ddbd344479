// The press of solver_bench.cpp on Bullet's deformable body with linear elasticity, as a yardstick from outside: one
// finger against a plane that rises, bone nodes fixed, dt = 1 ms. No strain limits there. Built where Bullet is
// installed.

#include <benchmark/benchmark.h>

#include <BulletSoftBody/btDeformableBodySolver.h>
#include <BulletSoftBody/btDeformableLinearElasticityForce.h>
#include <BulletSoftBody/btDeformableMultiBodyConstraintSolver.h>
#include <BulletSoftBody/btDeformableMultiBodyDynamicsWorld.h>
#include <BulletSoftBody/btSoftBody.h>
#include <BulletSoftBody/btSoftBodyHelpers.h>
#include <BulletSoftBody/btSoftBodyRigidBodyCollisionConfiguration.h>
#include <btBulletDynamicsCommon.h>

#include <algorithm>
#include <chrono>
#include <memory>
#include <string>

#include "bench/eigen_baseline.h"
#include "bench/pressed_finger.h"

namespace palpate {
namespace {

constexpr double young = 30e3, poisson = 0.45, density = 1050, dt = 1e-3;
constexpr double unit = 100;  // Bullet's tolerances are made for bodies of about 1: centimetres as its unit of length

btSoftBody* make_body(btSoftBodyWorldInfo& info, const TetMesh& mesh, const std::vector<bool>& in_bone) {
    std::string nodes = std::to_string(mesh.nodes.size()) + " 3 0 0\n";
    std::string elements = std::to_string(mesh.tets.size()) + " 4 0\n";
    for (std::size_t i = 0; i < mesh.nodes.size(); ++i) {
        nodes += std::to_string(i);
        for (double x : mesh.nodes[i]) nodes += " " + std::to_string(unit * x);
        nodes += "\n";
    }
    for (std::size_t e = 0; e < mesh.tets.size(); ++e) {
        elements += std::to_string(e);
        for (int i : mesh.tets[e]) elements += " " + std::to_string(i);
        elements += "\n";
    }
    btSoftBody* body =
        btSoftBodyHelpers::CreateFromTetGenData(info, elements.c_str(), nullptr, nodes.c_str(), false, true, true);
    double volume = 0;
    for (int e = 0; e < body->m_tetras.size(); ++e) volume += std::abs(body->m_tetras[e].m_rv) / 6;
    body->setTotalMass(btScalar(density * volume / (unit * unit * unit)));
    for (std::size_t i = 0; i < mesh.nodes.size(); ++i)
        if (in_bone[i]) body->setMass(int(i), 0);
    body->getCollisionShape()->setMargin(btScalar(0.001));
    body->m_cfg.kDF = 0.5;
    body->m_cfg.collisions = btSoftBody::fCollision::SDF_RD | btSoftBody::fCollision::SDF_RDN;
    body->m_sleepingThreshold = 0;
    btSoftBodyHelpers::generateBoundaryFaces(body);
    return body;
}

void bullet(benchmark::State& state, int elements) {
    const TetMesh mesh = index_finger_mesh(elements);
    std::vector<bool> in_bone(mesh.nodes.size(), false);
    for (int i : mesh.bone_nodes) in_bone[std::size_t(i)] = true;
    const double lowest = -touching_height(mesh);
    double median = 0, sunk = 0;
    for (auto _ : state) {
        btSoftBodyRigidBodyCollisionConfiguration configuration;
        btCollisionDispatcher dispatcher(&configuration);
        btDbvtBroadphase broadphase;
        btDeformableBodySolver body_solver;
        btDeformableMultiBodyConstraintSolver solver;
        solver.setDeformableSolver(&body_solver);
        btDeformableMultiBodyDynamicsWorld world(&dispatcher, &broadphase, &solver, &configuration, &body_solver);
        world.setGravity({0, 0, 0});
        world.getWorldInfo().m_gravity = {0, 0, 0};
        world.setImplicit(true);
        world.setLineSearch(false);
        world.getWorldInfo().m_sparsesdf.setDefaultVoxelsz(btScalar(0.25));
        btSoftBody* body = make_body(world.getWorldInfo(), mesh, in_bone);
        world.addSoftBody(body);
        // Stress has the unit of 1 / length.
        const double mu = young / (2 * (1 + poisson)) / unit,
                     lambda = young * poisson / ((1 + poisson) * (1 - 2 * poisson)) / unit;
        btDeformableLinearElasticityForce force{btScalar(mu), btScalar(lambda), btScalar(0)};
        world.addForce(body, &force);
        btBoxShape box({2, 2, 1});
        box.setMargin(btScalar(0.001));
        btRigidBody plane(btRigidBody::btRigidBodyConstructionInfo(0, nullptr, &box));
        plane.setCollisionFlags(plane.getCollisionFlags() | btCollisionObject::CF_KINEMATIC_OBJECT);
        plane.setActivationState(DISABLE_DEACTIVATION);
        world.addRigidBody(&plane);
        std::vector<double> us;
        for (int k = 1; k <= 250; ++k) {
            btTransform at;
            at.setIdentity();
            at.setOrigin({0, 0, btScalar(unit * (lowest + 2.5e-3 * k / 250) - 1.002)});
            plane.setWorldTransform(at);
            const auto start = std::chrono::steady_clock::now();
            world.stepSimulation(btScalar(dt), 1, btScalar(dt));
            us.push_back(std::chrono::duration<double, std::micro>(std::chrono::steady_clock::now() - start).count());
        }
        std::nth_element(us.begin(), us.begin() + 125, us.end());
        median = us[125];
        state.SetIterationTime(1e-6 * median);
        double lowest_now = 1e9;
        for (int i = 0; i < body->m_nodes.size(); ++i)
            lowest_now = std::min(lowest_now, double(body->m_nodes[i].m_x.z()) / unit);
        sunk = lowest + 2.5e-3 - lowest_now;
        world.removeRigidBody(&plane);
        world.removeSoftBody(body);
        delete body;
    }
    state.counters["T0s"] = median / time_eigen_baseline(mesh).all_nodes_us;
    state.counters["penetration_mm"] = 1e3 * sunk;
}
BENCHMARK_CAPTURE(bullet, linear_elastic_347, 347)->Iterations(3)->UseManualTime()->Unit(benchmark::kMicrosecond);

}  // namespace
}  // namespace palpate
