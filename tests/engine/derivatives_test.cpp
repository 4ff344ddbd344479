// Every energy's gradient and curvature against central differences, relative 1e-6.

#include <Eigen/Core>

#include "engine/bodies/pose_spring.h"
#include "engine/bodies/rigid_body.h"
#include "engine/contact/contact_terms.h"
#include "engine/skin/solve/coupled.h"
#include "engine/skin/solve/skin_step.h"
#include "tests/support.h"

namespace palpate {
namespace {

using testing::central_difference;
using testing::relative_error;
using testing::symmetric_modes;
using Numbers = std::vector<double>;

/// A random tetrahedron and a deformation of it.
struct Element {
    Vec3<double> g[3];
    double volume = 1.0 / 6;
    Numbers x;  ///< 12 coordinates
};

Element random_element(std::mt19937& random, double strength) {
    std::uniform_real_distribution<double> u(-1, 1);
    Element e;
    // Rest: the unit corner tetrahedron, whose shape gradients are the unit vectors.
    e.g[0] = {1, 0, 0}, e.g[1] = {0, 1, 0}, e.g[2] = {0, 0, 1};
    const double corner[12] = {0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1};
    for (double c : corner) e.x.push_back(c + strength * u(random));
    return e;
}

void unpack(const Numbers& x, Vec3<double> out[4]) {
    for (int a = 0; a < 4; ++a) out[a] = {x[3 * a], x[3 * a + 1], x[3 * a + 2]};
}

/// Checks gradient and blocks of an isotropic energy; Terms(svd of F + shift) -> PrincipalTerms.
template <class Terms>
void check_element(const Element& e, const Mat3<double>& shift, double scale, Terms terms, bool with_curvature) {
    auto svd_of = [&](const Numbers& x) {
        Vec3<double> p[4];
        unpack(x, p);
        return signed_svd(deformation_gradient(p, e.g) + shift);
    };
    auto energy = [&](const Numbers& x) { return e.volume * terms(svd_of(x).sigma).energy; };
    auto gradient = [&](const Numbers& x) {
        const auto svd = svd_of(x);
        Vec3<double> out[4] = {{0, 0, 0}, {0, 0, 0}, {0, 0, 0}, {0, 0, 0}};
        add_gradient(principal_to_matrix(svd, terms(svd.sigma).stress), e.g, e.volume, out);
        return Numbers{out[0].x, out[0].y, out[0].z, out[1].x, out[1].y, out[1].z,
                       out[2].x, out[2].y, out[2].z, out[3].x, out[3].y, out[3].z};
    };
    const Numbers g = gradient(e.x);
    for (std::size_t i = 0; i < 12; ++i)
        EXPECT_LT(relative_error(central_difference(energy, e.x, i, 1e-6), g[i], scale), 1e-6) << "component " << i;
    if (!with_curvature) return;
    const auto svd = svd_of(e.x);
    ElementBlocks<double> blocks;
    for (auto& b : blocks.block) b = Mat3<double>::zero();
    add_stiffness(svd, terms(svd.sigma), e.g, e.volume, blocks);
    for (int k = 0; k < 10; ++k)
        for (int i = 0; i < 3; ++i)
            for (int j = 0; j < 3; ++j) {
                const std::size_t row = 3 * block_pair[k][0] + i, column = 3 * block_pair[k][1] + j;
                auto component = [&](const Numbers& x) { return gradient(x)[row]; };
                EXPECT_LT(
                    relative_error(central_difference(component, e.x, column, 1e-6), blocks.block[k][i][j], scale),
                    1e-6)
                    << "block " << k << " entry " << i << j;
            }
}

TEST(Derivatives, CorotationalForceAndHessian) {
    std::mt19937 random(1);
    for (int trial = 0; trial < 200; ++trial) {
        // Up to strong deformation and inversion.
        const Element e = random_element(random, trial < 100 ? 0.2 : 0.8);
        check_element(
            e, Mat3<double>::zero(), 1e3,
            [](const Vec3<double>& s) { return corotational<Curvature::exact>(s, 1e3, 4e3); }, true);
        if (HasFailure()) FAIL() << "trial " << trial;
    }
}

TEST(Derivatives, SaintVenantKirchhoffForceAndHessian) {
    std::mt19937 random(11);
    for (int trial = 0; trial < 200; ++trial) {
        const Element e = random_element(random, trial < 100 ? 0.2 : 0.8);
        check_element(
            e, Mat3<double>::zero(), 1e4,
            [](const Vec3<double>& s) { return saint_venant_kirchhoff<Curvature::exact>(s, 1e3, 4e3); }, true);
        if (HasFailure()) FAIL() << "trial " << trial;
    }
}

TEST(Derivatives, NeoHookeanForceAndHessian) {
    std::mt19937 random(12);
    int flat = 0;
    for (int trial = 0; trial < 200; ++trial) {
        const Element e = random_element(random, trial < 100 ? 0.2 : 0.8);
        Vec3<double> p[4];
        unpack(e.x, p);
        const Vec3<double> s = signed_svd(deformation_gradient(p, e.g)).sigma;
        const double J = s.x * s.y * s.z;
        if (std::abs(J - 0.2) < 1e-4) continue;  // third derivatives jump there, and differences see them
        flat += J < 0.2;
        check_element(
            e, Mat3<double>::zero(), 1e4,
            [](const Vec3<double>& t) { return neo_hookean<Curvature::exact>(t, 1e3, 4e3); }, true);
        if (HasFailure()) FAIL() << "trial " << trial;
    }
    EXPECT_GT(flat, 20);
}

TEST(Derivatives, StrainLimitForceAndHessian) {
    std::mt19937 random(2);
    std::uniform_real_distribution<double> u(-1, 1);
    int checked = 0;
    for (int trial = 0; trial < 300; ++trial) {
        const Element e = random_element(random, 0.5);
        Mat3<double> shift;
        for (int i = 0; i < 9; ++i) shift.m[i / 3][i % 3] = 0.2 * u(random);
        Vec3<double> p[4];
        unpack(e.x, p);
        const Vec3<double> tau = signed_svd(deformation_gradient(p, e.g) + shift).sigma;
        // Away from the kinks, where the second derivative does not exist.
        bool smooth = true;
        for (int i = 0; i < 3; ++i) smooth = smooth && std::abs(tau[i] - 0.8) > 1e-3 && std::abs(tau[i] - 1.2) > 1e-3;
        if (!smooth || std::abs(tau[1] + tau[2]) < 0.05) continue;
        ++checked;
        check_element(
            e, shift, 1e4, [](const Vec3<double>& t) { return strain_limit<Curvature::exact>(t, 0.8, 1.2, 1e4); },
            true);
        if (HasFailure()) FAIL() << "trial " << trial;
    }
    EXPECT_GT(checked, 200);
}

TEST(Derivatives, PositiveCurvatureHasNoNegativeEigenvalue) {
    std::mt19937 random(3);
    for (int trial = 0; trial < 1000; ++trial) {
        const Element e = random_element(random, 1.5);
        Vec3<double> p[4];
        unpack(e.x, p);
        const auto svd = signed_svd(deformation_gradient(p, e.g));
        ElementBlocks<double> blocks;
        for (auto& b : blocks.block) b = Mat3<double>::zero();
        const PrincipalTerms<double> materials[] = {corotational<Curvature::positive>(svd.sigma, 1e3, 9e3),
                                                    saint_venant_kirchhoff<Curvature::positive>(svd.sigma, 1e3, 9e3),
                                                    neo_hookean<Curvature::positive>(svd.sigma, 1e3, 9e3)};
        add_stiffness(svd, materials[trial % 3], e.g, e.volume, blocks);
        add_stiffness(svd, strain_limit<Curvature::positive>(svd.sigma, 0.8, 1.2, 1e5), e.g, e.volume, blocks);
        Eigen::Matrix<double, 12, 12> H;
        for (int k = 0; k < 10; ++k)
            for (int i = 0; i < 3; ++i)
                for (int j = 0; j < 3; ++j)
                    H(3 * block_pair[k][0] + i, 3 * block_pair[k][1] + j) =
                        H(3 * block_pair[k][1] + j, 3 * block_pair[k][0] + i) = blocks.block[k][i][j];
        const Eigen::VectorXd eigenvalues = symmetric_modes(H).values;
        EXPECT_GT(eigenvalues.minCoeff(), -1e-10 * eigenvalues.maxCoeff());
    }
}

TEST(Derivatives, DistanceOfEveryShape) {
    std::mt19937 random(4);
    std::uniform_real_distribution<double> u(-0.05, 0.05);
    const Pose<double> pose{{0.003, -0.002, 0.004}, normalised(Quaternion<double>{0.8, 0.3, -0.4, 0.2})};
    for (const Shape& shape :
         {Shape{ShapeKind::plane, {}}, Shape{ShapeKind::box, {0.02, 0.015, 0.01}},
          Shape{ShapeKind::sphere, {0.02, 0, 0}}, Shape{ShapeKind::capsule, {0.012, 0.02, 0}},
          Shape{ShapeKind::cylinder, {0.015, 0.02, 0}}, Shape{ShapeKind::box, {0.02, 0.015, 0.01}, nullptr, 0.005},
          Shape{ShapeKind::cylinder, {0.015, 0.02, 0}, nullptr, 0.007}})
        for (int trial = 0; trial < 500; ++trial) {
            const Numbers x{u(random), u(random), u(random)};
            auto at = [&](const Numbers& y) { return surface_point(shape, pose, Vec3<double>{y[0], y[1], y[2]}); };
            auto distance = [&](const Numbers& y) { return at(y).distance; };
            const SurfacePoint<double> s = at(x);
            EXPECT_NEAR(norm(s.normal), 1, 1e-12);
            for (std::size_t i = 0; i < 3; ++i) {
                const double d = central_difference(distance, x, i, 1e-8);
                // At the medial axis of a box the two sides differ: there the difference is no derivative.
                const double coarse = central_difference(distance, x, i, 1e-5);
                if (std::abs(d - coarse) < 1e-4) { EXPECT_NEAR(d, s.normal[int(i)], 1e-6) << int(shape.kind); }
            }
        }
}

TEST(Derivatives, ContactWithFriction) {
    std::mt19937 random(5);
    std::uniform_real_distribution<double> u(-1, 1);
    const Shape plane{};
    const Pose<double> pose{{0, 0, 0}, normalised(Quaternion<double>{0.9, 0.2, -0.3, 0.1})};
    for (int trial = 0; trial < 300; ++trial) {
        const ContactState<double> state{std::max(0.0, u(random)),
                                         {u(random), u(random), u(random)},
                                         std::abs(u(random)),
                                         rotation_matrix(pose.rotation).column(2)};
        const Vec3<double> start{1e-3 * u(random), 1e-3 * u(random), 1e-3 * u(random)};
        auto terms = [&](const Numbers& x) {
            const Vec3<double> p{x[0], x[1], x[2]};
            return contact_terms(surface_point(plane, pose, p), p - start, 1e3, 4e2, state, true, 1.0);
        };
        auto energy = [&](const Numbers& x) { return terms(x).energy; };
        const Numbers x{1e-3 * u(random), 1e-3 * u(random), 1e-3 * u(random)};
        const ContactTerms<double> t = terms(x);
        for (int i = 0; i < 3; ++i) {
            EXPECT_LT(relative_error(central_difference(energy, x, std::size_t(i), 1e-8), t.gradient[i], 0.1), 1e-6);
            for (int j = 0; j < 3; ++j) {
                auto component = [&](const Numbers& y) { return terms(y).gradient[i]; };
                EXPECT_LT(
                    relative_error(central_difference(component, x, std::size_t(j), 1e-8), t.curvature[i][j], 1e3),
                    1e-6);
            }
        }
    }
}

TEST(Derivatives, Coupling) {
    std::mt19937 random(6);
    std::normal_distribution<double> n;
    for (int trial = 0; trial < 300; ++trial) {
        auto pose = [&] {
            return Pose<double>{{n(random), n(random), n(random)},
                                normalised(Quaternion<double>{n(random), n(random), n(random), n(random)})};
        };
        const Pose<double> base = pose();
        // Beyond a reach, too, where the curvature is that of a parabola above it.
        const bool held = trial % 2;
        const PoseSpring<double> spring{3.0, 2.0, pose(), held ? 0.5 : 1e30, held ? 0.2 : 1e30};
        auto coupling = [&](const Numbers& y) {  // y: position, left rotation
            return pose_spring(spring, {base.position + Vec3<double>{y[0], y[1], y[2]},
                                        rotation_step(Vec3<double>{y[3], y[4], y[5]}) * base.rotation})
                .energy;
        };
        const Numbers zero(6, 0.0);
        const PoseTerms<double> t = pose_spring(spring, base);
        for (int i = 0; i < 3; ++i) {
            const auto k = std::size_t(i);
            EXPECT_LT(relative_error(central_difference(coupling, zero, k, 1e-6), t.force[i], 1), 1e-6);
            EXPECT_LT(relative_error(central_difference(coupling, zero, 3 + k, 1e-6), t.torque[i], 1), 1e-6);
            for (int j = 0; j < 3; ++j) {
                // Second differences along rotations, which do not commute: the symmetric second derivative.
                const double h = 1e-4;
                auto at = [&](double a, double b) {
                    Numbers y = zero;
                    y[3 + k] += a, y[3 + std::size_t(j)] += b;
                    return coupling(y);
                };
                const double second = (at(h, h) - at(h, -h) - at(-h, h) + at(-h, -h)) / (4 * h * h);
                if (!held) { EXPECT_NEAR(second, i == j ? t.angular_curvature : 0, 1e-5); }
            }
        }
        for (int k = 0; k < 20; ++k) {
            Numbers y(6);
            for (double& v : y) v = 0.05 * n(random);
            const Vec3<double> p{y[0], y[1], y[2]}, turn{y[3], y[4], y[5]};
            const double above = t.energy + dot(t.force, p) + dot(t.torque, turn) +
                                 0.5 * (t.linear_curvature * dot(p, p) + t.angular_curvature * dot(turn, turn));
            // Of rotations to the second order, and there to rounding of the third.
            EXPECT_LE(coupling(y), above + 2 * std::pow(norm(turn), 3) + 1e-12) << trial;
        }
        EXPECT_LE(norm(t.force), 3.0 * spring.reach * (1 + 1e-12));
        EXPECT_LE(norm(t.torque), 4.0 * spring.half_turn * (1 + 1e-12));
    }
}

/// Settings under which no overlap is undone.
SolverSettings at_rest() {
    SolverSettings s;
    s.inertia = false;
    return s;
}

/// Bulges of a skin whose lowest node has been pulled out by a millimetre.
void bend_skin(SkinChunk<double>& chunk) {
    const auto flat = chunk.state.position;
    for (int node : chunk.topology->samples)
        if (chunk.topology->elimination[std::size_t(node)] >= 0) {
            chunk.state.position[std::size_t(3 * node + 2)] -= 1e-3;
            break;
        }
    detail::find_bulges<double>(chunk);
    double largest = 0;
    for (double x : chunk.scratch.bulge) largest = std::max(largest, std::abs(x));
    ASSERT_GT(largest, 2e-5);
    chunk.state.position = flat;
}

/// In place of a refinement: a skin that is curved between nodes.
constexpr int curved = 0;

/// A chunk in a scrambled state with limits, contact, friction and bone.
SkinChunk<double> scrambled_chunk(int sample_refinement = 1) {
    TetMesh mesh = testing::block_mesh(2, 2, 2, 0.005);
    mesh.curved_skin = sample_refinement == curved;
    const Pose<double> bone{{0, 0, 0.004}, normalised(Quaternion<double>{1, 0.05, 0.02, -0.03})};
    auto chunk = testing::make_chunk<double>(
        mesh, bone, {.low = 0.8, .high = 1.2, .friction = true, .sample_refinement = std::max(1, sample_refinement)});
    testing::touch_all(chunk, {0, {}, Pose<double>::identity(), Pose<double>::identity(), 0.5});
    testing::aim_all(chunk, 2000, 2, {{0.001, 0, 0.002}, normalised(Quaternion<double>{1, 0, 0.1, 0})});
    if (mesh.curved_skin) bend_skin(chunk);
    chunk.scratch.start_position = chunk.state.position;
    begin_slots(chunk, at_rest());
    chunk.scratch.inertia_target = chunk.state.position;
    std::mt19937 random(7);
    std::uniform_real_distribution<double> u(-1, 1);
    for (double& x : chunk.state.position) x += 1e-3 * u(random);
    detail::place_bone_nodes<double>(chunk);
    for (double& m : chunk.state.limit_multiplier) m = 1e3 * u(random);
    for (double& m : chunk.state.normal_multiplier) m = std::max(0.0, 0.05 * u(random));
    for (double& m : chunk.state.friction_radius) m = 0.02;
    for (std::size_t i = 2; i < chunk.state.friction_normal.size(); i += 3) chunk.state.friction_normal[i] = 1;
    return chunk;
}

/// Moves one of the chunk's unknowns: component d of unknown u (numbers of SkinTopology) by h.
void move(SkinChunk<double>& c, int u, int d, double h) {
    if (u < c.topology->node_count) {
        c.state.position[3 * u + d] += h;
        return;
    }
    Pose<double> bone = detail::load_pose<double>(c.state.bone.data());
    Vec3<double> by{0, 0, 0};
    by[d] = h;
    if (u == c.topology->bone_position)
        bone.position += by;
    else
        bone.rotation = rotation_step(by) * bone.rotation;
    detail::store_pose<double>(c.state.bone.data(), bone);
    detail::place_bone_nodes<double>(c);
}

/// What a chunk reports along a body's motions is the gradient of its potential, and its part of the Newton matrix that
/// of contact, but for the turning of normals, which the solve leaves out.
class AlongABody : public ::testing::TestWithParam<int> {};
INSTANTIATE_TEST_SUITE_P(Derivatives, AlongABody, ::testing::Values(2, curved));

TEST_P(AlongABody, GradientAndMatrix) {
    SkinChunk<double> c = scrambled_chunk(GetParam());
    c.has_bodies = true;
    resize_fields(c);
    LaneContact& object = c.contacts.at(0, 0);
    const Shape ball{ShapeKind::sphere, {0.02, 0, 0}};
    object.shape = ball;
    object.body = 0;
    object.mass_centre = {0.001, 0.002, -0.003};
    begin_slots(c, at_rest());
    const Pose<double> pose{{0.001, 0, -0.0205}, normalised(Quaternion<double>{1, 0.1, 0.2, 0.05})};
    const RigidBody body = [&] {
        RigidBody b;
        b.mass_centre = object.mass_centre;
        return b;
    }();
    auto energy = [&](const Motion& m, double exactness) {
        object.pose = object_pose(body, moved(centre_pose(body, pose), m, 1));
        place_slots(c);
        const double e = evaluate<double>(c, SolverSettings{}, exactness).energy;
        detail::add_body_gradients<double>(c);
        return e;
    };
    energy(Motion::Zero(), 0);
    const auto gradient = c.exchange.body_gradient;
    double scale = 0;
    for (double g : gradient) scale = std::max(scale, std::abs(g));
    ASSERT_GT(scale, 0.01);
    for (int k = 0; k < 6; ++k) {
        Motion along = Motion::Zero();
        along[k] = 1e-8;
        const double high = energy(along, 0), low = energy(-along, 0);
        EXPECT_NEAR(gradient[k], (high - low) / 2e-8, 1e-6 * scale) << k;
    }
    // Translations do not turn normals that do not depend on where they are: against a plane the matrix is exact.
    object.shape = {};
    object.pose = {{0, 0, 0.001}, Quaternion<double>::identity()};
    begin_slots(c, at_rest());
    evaluate<double>(c, SolverSettings{}, 1.0);
    detail::add_body_gradients<double>(c);
    detail::fill_columns<double>(c);
    for (int k = 0; k < 3; ++k) {
        const double h = 1e-8;
        std::vector<double> slope(6, 0.0);
        for (double side : {h, -h}) {
            object.pose.position = {0, 0, 0.001};
            object.pose.position[k] += side;
            place_slots(c);
            evaluate<double>(c, SolverSettings{}, 1.0);
            detail::add_body_gradients<double>(c);
            for (int i = 0; i < 3; ++i) slope[i] += (side > 0 ? 1 : -1) * c.exchange.body_gradient[i] / (2 * h);
        }
        for (int i = 0; i < 3; ++i)
            EXPECT_NEAR(c.exchange.body_matrix[6 * i + k], slope[i], 1e-4 * std::abs(c.exchange.body_matrix[14]))
                << i << " " << k;
    }
}

/// The whole incremental potential: its gradient along every node and along the bone's position and turn.
class Refined : public ::testing::TestWithParam<int> {};
INSTANTIATE_TEST_SUITE_P(Derivatives, Refined, ::testing::Values(1, 3, curved));

TEST_P(Refined, GradientOfTheWholePotential) {
    SkinChunk<double> chunk = scrambled_chunk(GetParam());
    const SolverSettings settings;
    evaluate<double>(chunk, settings, 0.0);
    const auto gradient = chunk.scratch.gradient;
    double scale = 0;
    for (int u : chunk.topology->unknowns)
        for (int d = 0; d < 3; ++d) scale = std::max(scale, std::abs(gradient[3 * u + d]));
    const auto position = chunk.state.position, bone = chunk.state.bone;
    for (int u : chunk.topology->unknowns)
        for (int d = 0; d < 3; ++d) {
            const double h = u == chunk.topology->bone_rotation ? 1e-6 : 1e-8;
            double energy[2];
            for (int side = 0; side < 2; ++side) {
                move(chunk, u, d, side == 0 ? h : -h);
                energy[side] = evaluate<double>(chunk, settings, 0.0).energy;
                chunk.state.position = position;
                chunk.state.bone = bone;
            }
            EXPECT_NEAR((energy[0] - energy[1]) / (2 * h), gradient[3 * u + d], 1e-6 * scale) << u << ", " << d;
        }
}

/// The exact Newton matrix against differences of the gradient, bone included.
TEST_P(Refined, MatrixOfTheWholePotential) {
    SkinChunk<double> chunk = scrambled_chunk(GetParam());
    const SkinTopology& t = *chunk.topology;
    const SolverSettings settings;
    evaluate<double>(chunk, settings, 1.0);
    const int n = 3 * int(t.unknowns.size());
    Eigen::MatrixXd matrix = Eigen::MatrixXd::Zero(n, n), differences(n, n);
    for (int column = 0; column < t.pattern.columns; ++column)
        for (int b = t.pattern.column_start[column]; b < t.pattern.column_start[column + 1]; ++b)
            for (int i = 0; i < 9; ++i) {
                const int r = 3 * t.pattern.row[b] + i / 3, c = 3 * column + i % 3;
                matrix(r, c) = chunk.scratch.blocks[9 * b + i];
                if (t.pattern.row[b] != column) matrix(c, r) = matrix(r, c);
            }
    const auto position = chunk.state.position, bone = chunk.state.bone;
    for (int u : t.unknowns)
        for (int d = 0; d < 3; ++d) {
            const double h = u == t.bone_rotation ? 1e-6 : 1e-9;
            for (int side = 0; side < 2; ++side) {
                move(chunk, u, d, side == 0 ? h : -h);
                evaluate<double>(chunk, settings, 1.0);
                for (int v : t.unknowns)
                    for (int i = 0; i < 3; ++i) {
                        double& to = differences(3 * t.elimination[v] + i, 3 * t.elimination[u] + d);
                        to = (side == 0 ? 0 : to) + (side == 0 ? 1 : -1) * chunk.scratch.gradient[3 * v + i] / (2 * h);
                    }
                chunk.state.position = position;
                chunk.state.bone = bone;
            }
        }
    // Turns do not commute: differences of the torque have a skew part, which the symmetric matrix leaves out.
    differences.bottomRightCorner<3, 3>() =
        (0.5 * (differences + differences.transpose())).bottomRightCorner<3, 3>().eval();
    const Eigen::VectorXd scale = matrix.diagonal().cwiseAbs().cwiseSqrt();
    for (int i = 0; i < n; ++i)
        for (int j = 0; j < n; ++j)
            EXPECT_NEAR(differences(i, j), matrix(i, j), 1e-6 * scale(i) * scale(j)) << i << ", " << j;
}

}  // namespace
}  // namespace palpate
