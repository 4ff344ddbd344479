// Orders of convergence in time and space, observed.

#include "tests/support.h"

namespace palpate {
namespace {

/// Positions after a smooth push to the side and back, hanging free from the bone, in `steps` steps of implicit Euler.
LaneArray<double> swung(int steps) {
    const double duration = 0.008, pi = 3.14159265358979323846;
    auto chunk = testing::make_chunk<double>(testing::block_mesh(3, 2, 3, 0.004), Pose<double>::identity(),
                                             {.limits = false, .objects = 0});
    SolverSettings settings;
    settings.dt = duration / steps;
    settings.tolerance = 1e-8;
    for (int k = 1; k <= steps; ++k) {
        Pose<double> target = Pose<double>::identity();
        target.position.x = 0.002 * (1 - std::cos(1.5 * pi * k / steps));
        target.position.z = 0.001 * std::sin(1.5 * pi * k / steps);
        testing::aim_all(chunk, 2000, 2, target);
        solve_skin(chunk, settings);
        EXPECT_TRUE(chunk.status[0].converged);
    }
    return chunk.state.position;
}

TEST(Convergence, TimeSteppingIsOfFirstOrder) {
    const auto finest = swung(6400);  // the slowest waves of the block take 16 ms: all are resolved
    auto error = [&](int steps) {
        const auto x = swung(steps);
        double squared = 0;
        for (std::size_t i = 0; i < x.size(); ++i) squared += (x[i] - finest[i]) * (x[i] - finest[i]);
        return std::sqrt(squared);
    };
    const double coarse = error(200), middle = error(400), fine = error(800);
    EXPECT_NEAR(std::log2(coarse / middle), 1, 0.25);
    EXPECT_NEAR(std::log2(middle / fine), 1, 0.2);
    std::printf("observed order in dt: %.2f, %.2f\n", std::log2(coarse / middle), std::log2(middle / fine));
}

/// Root mean square error of the displacement field of a block of 12 mm, `cells` cells to an edge, that its bone pulls
/// with constant acceleration. Without lateral contraction it stretches like a bar under its own weight,
/// u = rho a / E (L s - s^2 / 2) at the distance s from the bone.
double error_of_pulled_block(int cells) {
    const double length = 0.012, acceleration = 0.02, density = 1050, young = 30e3;
    const TetMesh mesh = testing::block_mesh(cells, cells, cells, length / cells);
    auto chunk = testing::make_chunk<double>(mesh, Pose<double>::identity(),
                                             {.limits = false, .objects = 0, .young = young, .poisson = 0});
    SolverSettings settings;
    settings.dt = 0.02;
    settings.tolerance = 1e-9;
    for (int k = 1; k <= 12; ++k) {
        Pose<double> target = Pose<double>::identity();
        target.position.z = 0.5 * acceleration * std::pow(settings.dt * k, 2);
        testing::aim_all(chunk, 1e5, 1e3, target);
        solve_skin(chunk, settings);
    }
    const Vec3<double> bone = load_vec3<double>(chunk.state.bone.data());
    double squared = 0;
    for (const auto& tet : mesh.tets) {
        Vec3<double> mean{0, 0, 0};
        double s = 0;
        for (int i : tet) {
            const Point& p = mesh.nodes[i];
            mean += 0.25 * (load_vec3<double>(&chunk.state.position[3 * i]) - bone - Vec3<double>{p[0], p[1], p[2]});
            s += 0.25 * (0.5 * length - p[2]);
        }
        mean.z += density * acceleration / young * (length * s - s * s / 2);
        squared += dot(mean, mean);
    }
    return std::sqrt(squared / double(mesh.tets.size()));
}

TEST(Convergence, DisplacementsAreOfSecondOrder) {
    const double coarse = error_of_pulled_block(4), middle = error_of_pulled_block(8), fine = error_of_pulled_block(12);
    const double first = std::log2(coarse / middle), second = std::log(middle / fine) / std::log(1.5);
    std::printf("observed order in displacement: %.2f, %.2f\n", first, second);
    EXPECT_NEAR(first, 2, 0.4);
    EXPECT_NEAR(second, 2, 0.2);
}

}  // namespace
}  // namespace palpate
