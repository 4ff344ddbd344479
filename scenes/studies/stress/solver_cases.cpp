// Extremes of the solver: states, gradients, materials, loads, limits.

#include <Eigen/Dense>
#include <cmath>
#include <map>
#include <random>

#include "engine/math/svd3.h"
#include "engine/skin/tissue/isotropic.h"
#include "scenes/studies/stress/cases.h"

namespace palpate::stress {

/// S1
StressOutcome start_states(int effort, const std::atomic<bool>& stop) {
    const char* const states[] = {"scrambled", "in a point", "in a plane", "on a line", "mirrored"};
    std::mt19937 random(1);
    std::normal_distribution<double> normal;
    int tried = 0, recovered = 0, reset = 0;
    double slowest = 0;
    std::string worst;
    for (int elements : {150, 347, 800})
        for (int state = 0; state < 5; ++state)
            for (int seed = 0; seed < (state == 0 ? (effort >= 10 ? 100 : 2) : 1); ++seed) {
                if (stop) break;
                SceneSpec spec = press_spec(elements, 0.05);
                World world = build_world(spec);
                Threads threads(1);
                auto& c = world.chunks.doubles[0];
                const Pose<double> start = spec.fingers[0].start;
                for (int i = 0; i < c.topology->node_count; ++i) {
                    double* x = &c.state.position[std::size_t(3 * i)];
                    if (state == 0)
                        for (int d = 0; d < 3; ++d) x[d] = 0.01 * normal(random);
                    if (state == 1)
                        for (int d = 0; d < 3; ++d) x[d] = 0;
                    if (state == 2) x[2] = 0;
                    if (state == 3) x[1] = x[2] = 0;
                    if (state == 4) x[2] = -x[2];
                }
                ++tried;
                bool good = false;
                for (int k = 0; k < 1000 && !good; ++k) {
                    aim(world, 0, start);
                    step(world, threads);
                    reset += skin_status(world, world.skins.owner(0)).reset;
                    if (!finite(world)) break;
                    good = off_rest(world) < 1e-6;
                    if (good) slowest = std::max(slowest, world.time);
                }
                good = good && inverted_elements(world) == 0;
                recovered += good;
                if (!good)
                    worst = text("; %s, %d elements: %.1e of the size away after 5 s, %d inverted", states[state],
                                 elements, off_rest(world), inverted_elements(world));
            }
    return {recovered == tried,
            text("%d of %d recovered, the slowest in %.2f s, %d resets", recovered, tried, slowest, reset) + worst};
}

/// S2
StressOutcome deformation_gradients(int effort, const std::atomic<bool>&) {
    std::mt19937 random(2);
    std::normal_distribution<double> normal;
    double rotation = 0, product = 0, indefinite = 0, force = 0;
    const int count = effort >= 10 ? 100000 : 10000;
    for (int trial = 0; trial < count; ++trial) {
        Mat3<double> F;
        for (auto& row : F.m)
            for (double& x : row) x = normal(random);
        if (trial % 10 == 1)
            for (auto& row : F.m) row[2] = row[1];  // rank 2
        if (trial % 10 == 2)
            for (auto& row : F.m) row[1] = row[2] = row[0];  // rank 1
        if (trial % 10 == 3) F = Mat3<double>::zero();
        if (trial % 10 == 4) F = Mat3<double>::identity();  // equal singular values
        if (trial % 10 == 5) F = Mat3<double>::identity(), F.m[2][2] = -1;
        if (trial % 10 == 6)
            for (auto& row : F.m) row[0] *= 1e6, row[2] *= 1e-6;  // condition 1e12
        const auto svd = signed_svd(F);
        double scale = 1e-300;
        for (const auto& row : F.m)
            for (double x : row) scale = std::max(scale, std::abs(x));
        const Mat3<double> R = svd.U * transpose(svd.V), RtR = transpose(R) * R;
        for (int i = 0; i < 3; ++i)
            for (int k = 0; k < 3; ++k) {
                rotation = std::max(rotation, std::abs(RtR.m[i][k] - (i == k)));
                double sum = 0;
                for (int j = 0; j < 3; ++j) sum += svd.U.m[i][j] * svd.sigma[j] * svd.V.m[k][j];
                product = std::max(product, std::abs(sum - F.m[i][k]) / scale);
            }
        if (trial % 10 == 6) continue;  // beyond any stretch that tissue sees
        // Force in principal stretches against differences, and the least eigenvalue of their positive Hessian.
        const double mu = 1e4, lambda = 9e4, h = 1e-6;
        const auto t = corotational<Curvature::positive>(svd.sigma, mu, lambda);
        Eigen::Matrix3d H;
        for (int i = 0; i < 3; ++i) {
            Vec3<double> up = svd.sigma, down = svd.sigma;
            up[i] += h, down[i] -= h;
            const double d = (corotational<Curvature::exact>(up, mu, lambda).energy -
                              corotational<Curvature::exact>(down, mu, lambda).energy) /
                             (2 * h);
            force = std::max(force, std::abs(d - t.stress[i]) / std::max(mu, std::abs(d)));
            for (int k = 0; k < 3; ++k) H(i, k) = i == k ? 2 * mu + lambda : lambda;
        }
        indefinite = std::max(indefinite, -H.selfadjointView<Eigen::Lower>().eigenvalues().minCoeff() / mu);
    }
    return {rotation < 1e-12 && product < 1e-12 && force < 1e-6 && indefinite < 1e-10,
            text("%d gradients: R'R = I to %.0e, U S V' = F to %.0e, forces to %.0e", count, rotation, product, force)};
}

/// S4
StressOutcome material_grid(int effort, const std::atomic<bool>& stop) {
    int tried = 0, good = 0;
    std::map<double, int> by_poisson, by_modulus, by_step, by_density;  // failures
    const std::vector<double> poissons{0, 0.3, 0.45, 0.49, 0.499, 0.4999}, moduli{1, 1e3, 3e4, 1e6, 1e9},
        steps{1e-5, 1e-3, 1e-2, 1e-1}, densities{1, 1e3, 1e5};
    const SceneSpec base = press_spec(150, 0.0003);
    for (double poisson : poissons)
        for (double young : moduli)
            for (double dt : steps)
                for (double density : densities) {
                    if (stop || (effort < 10 && (tried * 7) % 5 && density != 1e3)) continue;
                    SceneSpec spec = base;
                    FingerSpec& f = spec.fingers[0];
                    f.poisson_ratio = poisson;
                    f.young_modulus = young;
                    f.density = density;
                    spec.solver.dt = dt;
                    World world = build_world(spec);
                    Threads threads(1);
                    Pose<double> target = f.start;
                    bool sound = true;
                    int converged = 0;
                    const int count = 15;
                    for (int k = 0; k < count; ++k) {
                        target.position.z -= 1e-3 / count;
                        aim(world, 0, target);
                        step(world, threads);
                        const SkinStatus& s = skin_status(world, world.skins.owner(0));
                        sound = sound && finite(world) && !s.reset;
                        converged += s.converged;
                    }
                    ++tried;
                    good += sound && converged == count;
                    if (sound && converged == count) continue;
                    ++by_poisson[poisson], ++by_modulus[young], ++by_step[1e3 * dt], ++by_density[density];
                }
    std::string where;
    for (const auto& [what, failures] : {std::pair{"Poisson", &by_poisson}, std::pair{"E in Pa", &by_modulus},
                                         std::pair{"dt in ms", &by_step}, std::pair{"kg/m3", &by_density}}) {
        where += text("; failures by %s:", what);
        for (const auto& [value, number] : *failures) where += text(" %g: %d", value, number);
    }
    return {good == tried, text("%d of %d presses converge in every step", good, tried) + (good < tried ? where : "")};
}

namespace {

/// Pressed on the table with all that the coupling may pull, `ramp` seconds after touching.
StressOutcome press_hard(double newton, double ramp, double hold, const std::atomic<bool>& stop) {
    SceneSpec spec = press_spec(347);
    FingerSpec& f = spec.fingers[0];
    f.coupling.max_force = newton;
    World world = build_world(spec);
    Threads threads(1);
    double limits = 0, last_limits = 0;
    while (world.time < ramp + hold && !stop) {
        Pose<double> down = f.start;
        down.position.z -= 1.2 * newton / f.coupling.stiffness * std::min(1.0, world.time / ramp);
        aim(world, 0, down);
        step(world, threads);
        last_limits = skin_status(world, world.skins.owner(0)).limit_violation;
        limits = std::max(limits, last_limits);
        if (!finite(world)) return {false, text("not finite at %.2f s", world.time)};
    }
    const double force = world.contact_surfaces[0].normal_force, end = world.time;
    while (world.time < end + 2 && !stop) {
        aim(world, 0, f.start);
        step(world, threads);
    }
    const double left = off_rest(world);
    return {
        std::abs(force / newton - 1) < 1e-3 && limits < 1e-3 && left < 1e-5,
        text("%.2f N after %.0f s; limits exceeded by %.0e at worst, %.0e at its end; %.0e of the size from rest 2 s "
             "after it",
             force, hold, limits, last_limits, left)};
}

}  // namespace

/// S6
StressOutcome heavy_press(int effort, const std::atomic<bool>& stop) {
    return press_hard(1000, 0.6, effort >= 10 ? 60 : 1, stop);
}

/// S6b: the coupling's target falls at 5 m/s, the fastest that it may.
StressOutcome heavy_blow(int effort, const std::atomic<bool>& stop) {
    return press_hard(1000, 0.12, effort >= 10 ? 10 : 0.5, stop);
}

/// S7
StressOutcome tight_limits(int, const std::atomic<bool>& stop) {
    int most = 0;
    double violation = 0, reported = 0;
    for (double room : {0.1, 0.01, 1e-3, 1e-6}) {
        if (stop) break;
        SceneSpec spec = press_spec(150);
        spec.fingers[0].limit_low = 1 - room;
        spec.fingers[0].limit_high = 1 + room;
        World world = build_world(spec);
        Threads threads(1);
        Pose<double> target = spec.fingers[0].start;
        for (int k = 0; k < 40; ++k) {
            target.position.z -= 1e-4;
            aim(world, 0, target);
            step(world, threads);
            const SkinStatus& s = skin_status(world, world.skins.owner(0));
            most = std::max(most, s.newton_iterations);
            if (!finite(world)) return {false, text("not finite with limits of 1 +- %g", room)};
            // Not kept means not converged, and that is said.
            if (s.limit_violation > 1e-3 && s.converged) violation = std::max(violation, s.limit_violation);
            reported = std::max(reported, s.limit_violation);
        }
    }
    return {
        violation == 0 && most <= SolverSettings{}.newton_iterations,
        text("limits of 1 +- 0.1 to 1e-6: at most %d iterations a step; where they were exceeded (by up to %.0e) the "
             "step said so",
             most, reported)};
}

}  // namespace palpate::stress
