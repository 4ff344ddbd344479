// How scans lie: turned, mirrored, cut, bent, noisy and coarse fingers are never taken upside down.

#include "meshes/finger_orientation.h"

#include <Eigen/Geometry>
#include <cstdio>
#include <map>

#include "meshes/finger_shape.h"
#include "meshes/input_error.h"
#include "tests/support.h"

namespace palpate {
namespace {

using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;

struct Scan {
    Surface surface;
    Matrix3d turned;  ///< columns: finger frame in the file's axes
};

/// Vertices snapped to a grid, and triangles that vanish by it left out: as a coarse scan.
void decimate(Surface& s, double grid) {
    std::map<std::array<int, 3>, int> first;
    std::vector<int> to(s.vertices.size());
    for (std::size_t i = 0; i < s.vertices.size(); ++i) {
        std::array<int, 3> cell;
        for (std::size_t d = 0; d < 3; ++d) cell[d] = int(std::lround(s.vertices[i][d] / grid));
        to[i] = first.try_emplace(cell, int(i)).first->second;
    }
    std::vector<std::array<int, 3>> kept;
    for (auto t : s.triangles) {
        for (int& i : t) i = to[std::size_t(i)];
        if (t[0] != t[1] && t[1] != t[2] && t[0] != t[2]) kept.push_back(t);
    }
    s.triangles = kept;
}

Scan random_scan(std::mt19937& random) {
    auto in = [&](double a, double b) { return std::uniform_real_distribution<double>(a, b)(random); };
    FingerShape f = finger_shape(finger_shape_names()[random() % 5]);
    f.length *= in(0.9, 1.1), f.width *= in(0.9, 1.1), f.thickness *= in(0.9, 1.08);
    f.pad_bulge = in(0.03, 0.3), f.nail_drop = in(0.1, 0.4);
    Scan scan{finger_surface(f), {}};
    if (random() % 3 == 0) decimate(scan.surface, in(0.001, 0.002));
    const double cut = in(-0.5, -0.3) * f.length, tilt = in(-0.25, 0.25), bend = in(-0.06, 0.06);
    std::normal_distribution<double> noise(0, in(1e-6, 2.5e-4));
    scan.turned = Quaterniond(in(-1, 1), in(-1, 1), in(-1, 1), in(-1, 1)).normalized().toRotationMatrix();
    const bool mirrored = random() % 2;
    const double scale = in(0.8, 1.25);
    for (Point& p : scan.surface.vertices) {
        const double along = p[0] / f.length;
        p[0] = std::max(p[0], cut + tilt * p[2]);
        p[2] += bend * f.length * along * along;
        for (double& x : p) x = scale * (x + noise(random));
        const Vector3d v = scan.turned * Vector3d(p[0], mirrored ? -p[1] : p[1], p[2]);
        p = {v[0], v[1], v[2]};
    }
    if (mirrored)
        for (auto& t : scan.surface.triangles) std::swap(t[1], t[2]);
    return scan;
}

TEST(Orientation, OfTurnedCutBentNoisyAndCoarseFingersIsRightOrRefused) {
    std::mt19937 random(3);
    int refused = 0;
    constexpr int count = 250;
    for (int k = 0; k < count; ++k) {
        const Scan scan = random_scan(random);
        const OrientationGuess g = guess_orientation(scan.surface);
        if (g.confidence < least_orientation_confidence) {
            ++refused;
            continue;
        }
        EXPECT_GT(scan.turned.col(0).dot(Vector3d(g.orientation.tip.data())), 0.8)
            << "scan " << k << ", " << describe(g);
        EXPECT_GT(scan.turned.col(2).dot(Vector3d(g.orientation.dorsal.data())), 0.8)
            << "scan " << k << ", " << describe(g);
    }
    std::printf("%d of %d refused\n", refused, count);
    EXPECT_LT(refused, count / 4);
}

TEST(Orientation, OfBuiltInFingersIsTheirs) {
    for (const std::string& name : finger_shape_names()) {
        const OrientationGuess g = guess_orientation(finger_surface(finger_shape(name)));
        EXPECT_GT(g.confidence, least_orientation_confidence) << name;
        EXPECT_GT(g.orientation.tip[0], 0.99) << name;
        EXPECT_GT(g.orientation.dorsal[2], 0.99) << name;
    }
}

TEST(Orientation, OfRealScansHasTheNailOnTheFlatSide) {
    PALPATE_NEED_SHARED_DATA(data);
    // Seen in pictures of them: the directions of tip and nail in the files' axes.
    const struct {
        const char* file;
        Vector3d tip, dorsal;
    } known[] = {{"mh_index_distal.obj", {0.02, -0.69, 0.73}, {0.70, 0.53, 0.48}},
                 {"webxr_thumb_distal.obj", {0.25, -0.49, -0.84}, {-0.35, 0.76, -0.55}}};
    for (const auto& k : known) {
        const OrientationGuess g = guess_orientation(read_surface(data / "fingers" / k.file).surface);
        EXPECT_GT(g.confidence, least_orientation_confidence) << k.file;
        EXPECT_GT(k.tip.dot(Vector3d(g.orientation.tip.data())), 0.9) << k.file;
        EXPECT_GT(k.dorsal.dot(Vector3d(g.orientation.dorsal.data())), 0.9) << k.file;
    }
}

TEST(Orientation, OfABallIsRefusedAndDirectionsMustDiffer) {
    Surface ball = finger_surface(finger_shape("index"));
    for (Point& p : ball.vertices) {
        const Vector3d v = 0.01 * Vector3d(p.data()).normalized();
        p = {v[0], v[1], v[2]};
    }
    EXPECT_LT(guess_orientation(ball).confidence, least_orientation_confidence);
    EXPECT_THROW(turn_to_finger_frame(ball, {{1, 0, 0}, {2, 0, 0}}), InputError);
    EXPECT_THROW(turn_to_finger_frame(ball, {{0, 0, 0}, {0, 0, 1}}), InputError);
    const Surface turned = turn_to_finger_frame(finger_surface(finger_shape("index")), {{0, 3, 0}, {0, 1, 2}});
    const auto box = bounds(turned.vertices);
    EXPECT_NEAR(box[1][0], 0.5 * finger_shape("index").width, 1e-4) << "the file's y is the finger's x";
    EXPECT_NEAR(box[0][0], -box[1][0], 1e-12);
}

TEST(Orientation, IsDrawn) {
    const std::string svg = orientation_picture(finger_surface(finger_shape("index")), {}, "a <finger> & its axes");
    EXPECT_NE(svg.find("nail (z)"), std::string::npos);
    EXPECT_NE(svg.find("a &lt;finger> &amp; its axes"), std::string::npos);
    EXPECT_EQ(svg.find("nan"), std::string::npos);
}

}  // namespace
}  // namespace palpate
