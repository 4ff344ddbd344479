// The order of the time stepping, observed.

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

}  // namespace
}  // namespace palpate
