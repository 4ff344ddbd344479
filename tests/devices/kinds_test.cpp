// Every device kind: derivatives, workspace, bad geometry. The numbers of chinello-3rrs were computed
// independently with 40 digits.

#include <random>

#include "devices/device.h"
#include "devices/matching/platform_force.h"
#include "tests/support.h"

namespace palpate {
namespace {

class EveryKind : public ::testing::TestWithParam<std::string> {
  protected:
    const DeviceKind& kind() const { return *find_kind(GetParam()); }
    Coordinates random_inside(std::mt19937& random, const DeviceModel& m) const {
        for (int i = 0; i < 100000; ++i) {
            Coordinates w(m.rest.size());
            for (int k = 0; k < w.size(); ++k)
                w[k] = std::uniform_real_distribution<double>(kind().configuration_min[k],
                                                              kind().configuration_max[k])(random);
            if (inside_workspace(m, w)) return w;
        }
        return m.rest;
    }
};

TEST_P(EveryKind, DerivativesAgreeWithDifferences) {
    std::mt19937 random(1);
    const DeviceModel m = kind().defaults();
    for (int trial = 0; trial < 300; ++trial) {
        const Coordinates w = random_inside(random, m);
        const Platform p = kind().platform(m, w);
        const Joints j = kind().joints(m, w);
        EXPECT_NEAR(p.normal.norm(), 1, 1e-12);
        EXPECT_NEAR(p.rotation.determinant(), 1, 1e-12);
        for (int k = 0; k < w.size(); ++k) {
            const double h = 1e-6 * kind().configuration_scale[k];
            Coordinates a = w, b = w;
            a[k] += h, b[k] -= h;
            const Eigen::VectorXd dq = (kind().joints(m, a).q - kind().joints(m, b).q) / (2 * h);
            EXPECT_LT((dq - j.dq.col(k)).norm(), 1e-6 * std::max(1.0, dq.norm()));
            EXPECT_LT(
                ((kind().platform(m, a).centre - kind().platform(m, b).centre) / (2 * h) - p.dcentre.col(k)).norm(),
                1e-6);
            EXPECT_LT(
                ((kind().platform(m, a).normal - kind().platform(m, b).normal) / (2 * h) - p.dnormal.col(k)).norm(),
                1e-6);
        }
    }
}

/// Virtual work: what the joints' torques do is what the force does on the platform.
TEST_P(EveryKind, TorquesPushThePlatformWithTheForce) {
    std::mt19937 random(2);
    std::normal_distribution<double> n;
    const DeviceModel m = kind().defaults();
    const Coordinates largest = largest_torques(m);
    ASSERT_TRUE(largest.allFinite());
    int checked = 0;
    for (int trial = 0; trial < 200; ++trial) {
        const Coordinates w = random_inside(random, m);
        const Platform p = kind().platform(m, w);
        const Joints j = kind().joints(m, w);
        if (j.dq.fullPivLu().rcond() < 1e-4) continue;  // singular: a force takes any torque
        ++checked;
        const Coordinates torque = torques_for_force(m, w, 3.0);
        Coordinates dw(w.size());
        for (int k = 0; k < dw.size(); ++k) dw[k] = n(random) * kind().configuration_scale[k];
        const double by_joints = torque.dot(j.dq * dw), by_force = 3.0 * p.normal.dot(p.dcentre * dw);
        EXPECT_NEAR(by_joints, by_force, 1e-9 * std::max(1e-3, std::abs(by_force)));
        // Pressed on: no farther than asked for, inside the limits, and with nearly the same tilt.
        const Coordinates there = pressed_on(m, w, 0.002);
        EXPECT_TRUE(inside_workspace(m, there, 1e-9));
        const Platform q = kind().platform(m, there);
        EXPECT_LT((q.centre - p.centre).norm(), 0.003);
        EXPECT_GT(p.normal.dot(q.centre - p.centre), -1e-6);
        EXPECT_GT(p.normal.dot(q.normal), std::cos(5 * degree));
    }
    EXPECT_GT(checked, 100);
}

TEST_P(EveryKind, RestIsInsideAndDefaultsAreValid) {
    const DeviceModel m = kind().defaults();
    EXPECT_TRUE(validate(m).empty());
    EXPECT_TRUE(inside_workspace(m, m.rest));
}

TEST_P(EveryKind, OutOfReachGivesFiniteJointsOutsideTheLimits) {
    std::mt19937 random(2);
    const DeviceModel m = kind().defaults();
    for (int trial = 0; trial < 2000; ++trial) {
        Coordinates w(m.rest.size());
        for (int k = 0; k < w.size(); ++k)
            w[k] = std::uniform_real_distribution<double>(kind().configuration_min[k],
                                                          kind().configuration_max[k])(random);
        const Joints j = kind().joints(m, w);
        EXPECT_TRUE(j.q.allFinite() && j.dq.allFinite());
        if (!j.closed) { EXPECT_LT(joint_margins(m, j.q).minCoeff(), 0); }
    }
}

TEST_P(EveryKind, ImpossibleGeometryIsRefusedWithItsNumbers) {
    DeviceModel m = kind().defaults();
    m.joint_min.setConstant(1);
    m.joint_max.setConstant(-1);
    EXPECT_FALSE(validate(m).empty());
    m = kind().defaults();
    m.geometry.back() = 1;  // unused numbers do not matter
    EXPECT_TRUE(validate(m).empty());
    m.rest = 3 * kind().configuration_max;
    ASSERT_FALSE(validate(m).empty());
    EXPECT_NE(validate(m)[0].find("rest"), std::string::npos);
    for (std::size_t i = 0; i < kind().geometry_names.size(); ++i) {
        m = kind().defaults();
        m.geometry[i] = -1;
        EXPECT_FALSE(validate(m).empty());
    }
}

TEST_P(EveryKind, NormalIsThePlatformsAxis) {
    std::mt19937 random(3);
    const DeviceModel m = kind().defaults();
    for (int trial = 0; trial < 100; ++trial) {
        const Platform p = kind().platform(m, random_inside(random, m));
        EXPECT_LT((p.normal + p.rotation.col(2)).norm(), 1e-12);
    }
    // Level at rest, facing the pad that is seated there.
    EXPECT_LT((kind().platform(m, m.rest).normal + Eigen::Vector3d::UnitZ()).norm(), 1e-9);
}

TEST_P(EveryKind, TheSkeletonHasTheSameLinesForEveryPoseAndReachesThePlatform) {
    std::mt19937 random(4);
    const DeviceModel m = kind().defaults();
    const Skeleton rest = kind().skeleton(m, m.rest);
    for (int trial = 0; trial < 50; ++trial) {
        const Coordinates w = random_inside(random, m);
        const Skeleton lines = kind().skeleton(m, w);
        const Platform p = kind().platform(m, w);
        ASSERT_EQ(lines.size(), rest.size());
        double nearest = 1;
        for (std::size_t k = 0; k < lines.size(); ++k) {
            ASSERT_EQ(lines[k].size(), rest[k].size());
            for (const auto& x : lines[k]) {
                ASSERT_TRUE(x.allFinite());
                nearest = std::min(nearest, std::abs((x - p.centre).dot(p.normal)));
            }
        }
        EXPECT_LT(nearest, 1e-9);
        // Cranks and links keep their lengths.
        if (kind().geometry_names.size() == 6)
            for (std::size_t k = 2; k < lines.size(); ++k) {
                EXPECT_NEAR((lines[k][1] - lines[k][0]).norm(), m.geometry[4], 1e-9);
                EXPECT_NEAR((lines[k][2] - lines[k][1]).norm(), m.geometry[5], 1e-9);
            }
    }
}

TEST(LegsThatCannotClose, AreRefusedWithTheirNumbers) {
    for (const char* name : {"chinello-3rrs", "rrs-exact"}) {
        DeviceModel m = find_kind(name)->defaults();
        for (std::size_t i = 0; i < m.kind->geometry_names.size(); ++i) m.geometry[i] = 0.4 / double(1 + i * i);
        ASSERT_FALSE(validate(m).empty());
        EXPECT_NE(validate(m)[0].find("rest"), std::string::npos);
    }
}

/// The mechanism itself: from crank angles to points, and back to what the inverse kinematics says.
TEST(RrsExact, CranksLinksAndPlanesCloseAtEveryPose) {
    std::mt19937 random(5);
    std::uniform_real_distribution<double> u(-1, 1);
    const DeviceModel m = find_kind("rrs-exact")->defaults();
    const auto& g = m.geometry;
    const double a = g[0], ah = g[1], b = g[2], bh = g[3];
    const Eigen::Vector3d A[3] = {
        {a, 0, 0}, {-std::sqrt(a * a - ah * ah), -ah, 0}, {-std::sqrt(a * a - ah * ah), ah, 0}};
    const Eigen::Vector3d B[3] = {
        {b, 0, 0}, {-std::sqrt(b * b - bh * bh), -bh, 0}, {-std::sqrt(b * b - bh * bh), bh, 0}};
    int tried = 0;
    for (int trial = 0; trial < 2000; ++trial) {
        const Coordinates w =
            Eigen::Vector3d(25 * degree * u(random), 25 * degree * u(random), 0.024 + 0.003 * u(random));
        const Joints j = m.kind->joints(m, w);
        if (!inside_workspace(m, w)) continue;
        ++tried;
        const Platform p = m.kind->platform(m, w);
        for (int leg = 0; leg < 3; ++leg) {
            const Eigen::Vector3d out = (B[leg] - A[leg]).normalized();
            const Eigen::Vector3d knee =
                A[leg] + g[4] * (std::cos(j.q[leg]) * out + std::sin(j.q[leg]) * Eigen::Vector3d::UnitZ());
            const Eigen::Vector3d seat = p.centre + p.rotation * B[leg];
            EXPECT_NEAR((seat - knee).norm(), g[5], 1e-12);
            EXPECT_NEAR((seat - A[leg]).dot(Eigen::Vector3d(-out.y(), out.x(), 0)), 0, 1e-12);
        }
    }
    EXPECT_GT(tried, 500);
}

TEST(RrsExact, AgreesWithThePapersFormWhereThatIsExact) {
    // 120 degrees between legs: half = radius sin 60.
    DeviceModel exact = find_kind("rrs-exact")->defaults(), paper = find_kind("chinello-3rrs")->defaults();
    for (DeviceModel* m : {&exact, &paper}) {
        m->geometry[1] = m->geometry[0] * std::sqrt(0.75);
        m->geometry[3] = m->geometry[2] * std::sqrt(0.75);
    }
    std::mt19937 random(6);
    std::uniform_real_distribution<double> u(-1, 1);
    for (int trial = 0; trial < 200; ++trial) {
        const Coordinates w = Eigen::Vector3d(15 * degree * u(random), 15 * degree * u(random), 0.024);
        const Platform a = exact.kind->platform(exact, w), b = paper.kind->platform(paper, w);
        EXPECT_LT((a.centre - b.centre).norm(), 1e-9);
        EXPECT_LT((a.rotation - b.rotation).norm(), 1e-9);
        EXPECT_LT((exact.kind->joints(exact, w).q - paper.kind->joints(paper, w).q).norm(), 1e-6);
    }
}

TEST(RrsExact, TheLastDigitOfALengthTurnsNoPlane) {
    // Radii alike, legs at 120 degrees: seats meet, but for the rounding of the half, 17.32050808 mm.
    DeviceModel m = find_kind("rrs-exact")->defaults();
    const auto joints = [&](double half_mm) {
        m.geometry[2] = m.geometry[0] = 0.020;
        m.geometry[1] = 0.020 * std::sqrt(0.75);
        m.geometry[3] = 1e-3 * half_mm;
        return m.kind->joints(m, Eigen::Vector3d(8 * degree, -12 * degree, 0.0235)).q;
    };
    const Coordinates exact = joints(20 * std::sqrt(0.75));
    for (const double half_mm : {17.3205, 17.3206, 17.320508, 17.321, 17.32})
        EXPECT_LT((joints(half_mm) - exact).cwiseAbs().maxCoeff(), 0.05 * degree) << half_mm;
}

TEST(Chains, KnownPose) {
    const DeviceModel m = find_kind("serial-5dof")->defaults();
    Coordinates q(5);
    q << 0.25, -0.5, 0.125, 0, 0.3;
    const Platform p = m.kind->platform(m, q);
    EXPECT_LT((p.centre - Eigen::Vector3d(0.002, -0.004, 0.0246 + 0.001)).norm(), 1e-15);
    EXPECT_LT((p.normal - Eigen::Vector3d(0, std::sin(0.3), -std::cos(0.3))).norm(), 1e-15);
}

INSTANTIATE_TEST_SUITE_P(Kinds, EveryKind, ::testing::ValuesIn(kind_names()), [](const auto& info) {
    std::string n = info.param;
    for (char& c : n)
        if (!std::isalnum(static_cast<unsigned char>(c))) c = '_';
    return n;
});

struct Known {
    double theta, psi, dz;
    double q[3], px, py, n[3];
};

TEST(Chinello3rrs, KnownPoses) {
    const DeviceModel m = find_kind("chinello-3rrs")->defaults();
    for (const Known& k :
         {Known{0, 0, 24, {-0.049762639, -0.002926831, -0.002926831}, 0, 0, {0, 0, -1}},
          Known{10, 0, 24, {-0.416539915, 0.286461982, 0.286461982}, -0.151922470, 0, {-0.173648178, 0, -0.984807753}},
          Known{8,
                -12,
                23.5,
                {-0.402154095, 0.394827620, -0.025214878},
                0.116938495,
                0.291107405,
                {-0.139173101, -0.205888309, -0.968628336}}}) {
        const Coordinates w = Eigen::Vector3d(k.theta * degree, k.psi * degree, 1e-3 * k.dz);
        const Joints j = m.kind->joints(m, w);
        const Platform p = m.kind->platform(m, w);
        for (int i = 0; i < 3; ++i) {
            EXPECT_NEAR(j.q[i], k.q[i], 1e-8);
            EXPECT_NEAR(p.normal[i], k.n[i], 1e-8);
        }
        EXPECT_NEAR(1e3 * p.centre.x(), k.px, 1e-8);
        EXPECT_NEAR(1e3 * p.centre.y(), k.py, 1e-8);
        EXPECT_NEAR(1e3 * p.centre.z(), k.dz, 1e-12);
    }
    const Joints j = m.kind->joints(m, Eigen::Vector3d(0, 0, 0.024));
    const double expected[3][3] = {{-2.022991884, 0, 0.101149594},
                                   {1.677524352, -1.034776149, 0.098550109},
                                   {1.677524352, 1.034776149, 0.098550109}};
    for (int i = 0; i < 3; ++i)
        for (int k = 0; k < 3; ++k) EXPECT_NEAR(j.dq(i, k) * (k == 2 ? 1e-3 : 1), expected[i][k], 1e-8);
}

TEST(Chinello3rrs, RollsThirtyFiveDegreesAtMidHeight) {
    const DeviceModel m = find_kind("chinello-3rrs")->defaults();
    EXPECT_TRUE(inside_workspace(m, Eigen::Vector3d(0, 34.99 * degree, 0.0242936)));
    EXPECT_FALSE(inside_workspace(m, Eigen::Vector3d(0, 35.02 * degree, 0.0242936)));
    EXPECT_TRUE(inside_workspace(m, Eigen::Vector3d(0, 0, 0.0306)) &&
                !inside_workspace(m, Eigen::Vector3d(0, 0, 0.0307)));
}

}  // namespace
}  // namespace palpate
