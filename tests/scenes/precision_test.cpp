// Single precision: what it is asked for is what it can know.

#include <cmath>

#include "scenes/run/simulation.h"
#include "tests/support.h"

namespace palpate {
namespace {

struct Pressed {
    Vec3<double> force{0, 0, 0};
    int most_iterations = 0, unconverged = 0;
};

/// A finger pressed near the corner of a table of this half width [mm], and drawn aside.
Pressed press_on_table(int half_mm, const std::string& kind, const std::string& precision) {
    const std::string half = std::to_string(half_mm), off = std::to_string(half_mm - 50);
    const std::string object = kind == "box"
                                   ? "size_mm = [" + std::to_string(2 * half_mm) + ", " + std::to_string(2 * half_mm) +
                                         ", 20]\nposition_mm = [" + off + ", " + off + ", -10]\n"
                                   : "position_mm = [" + off + ", " + off + ", 0]\n";
    const std::string text = "duration_s = 0.6\ndt_ms = 5\n[solver]\nprecision = \"" + precision +
                             "\"\n[[object]]\nname = \"table\"\nkind = \"" + kind + "\"\nfriction = 0.5\n" + object +
                             "[[finger]]\nname = \"index\"\nfinger = \"index-median\"\ntrack = [\n"
                             "{ t_s = 0.0, position_mm = [0, 0, 9.5] },\n{ t_s = 0.4, position_mm = [0, 0, 6.0] },\n"
                             "{ t_s = 0.6, position_mm = [2, 0, 6.0] } ]\n";
    Simulation s = make_simulation(load_scene_text(text, "table.toml", {}), 1);
    Pressed out;
    for (int k = 0; k < 120; ++k) {
        advance(s, next_inputs(s));
        const SkinStatus& status = skin_status(s.world, s.fingers[0]);
        out.most_iterations = std::max(out.most_iterations, status.newton_iterations);
        out.unconverged += !status.converged;
    }
    out.force = s.world.contact_surfaces[0].total;
    return out;
}

/// Half the steps on a table whose middle was 0.45 m away took 200 iterations and did not converge, and 4.5 m away
/// residuals were 0.04 of 0.6 N.
TEST(Precision, InFloatAFingerOnAWideTableIsAsGoodAsOnASmallOne) {
    for (const std::string kind : {"box", "plane"}) {
        const Pressed reference = press_on_table(50, kind, "double");
        ASSERT_GT(norm(reference.force), 0.4);
        for (const int half : {50, 500, 5000}) {
            const Pressed pressed = press_on_table(half, kind, "float");
            EXPECT_LT(norm(pressed.force - reference.force), 1e-3 * norm(reference.force)) << kind << " " << half;
            EXPECT_LT(pressed.most_iterations, 150) << kind << " " << half;  // in one step of a plane 109
            EXPECT_EQ(pressed.unconverged, 0) << kind << " " << half;
        }
    }
}

/// What ten fingers hold comes to rest: each step was 200 iterations of rounding.
TEST(Precision, InFloatAGraspOfTenFingersComesToRest) {
    Simulation s = make_simulation(
        load_scene(testing::scenes + "two_hands.toml", {"solver.precision=float", "solver.preset=balanced"}), 2);
    int converged = 0, most_iterations = 0;
    for (int k = 0; k < 500; ++k) {
        advance(s, next_inputs(s));
        if (k < 450) continue;
        const SkinStatus& status = skin_status(s.world, s.fingers[0]);
        converged += status.converged;
        most_iterations = std::max(most_iterations, status.newton_iterations);
    }
    EXPECT_GT(converged, 30);
    EXPECT_LE(most_iterations, 2);
}

}  // namespace
}  // namespace palpate
