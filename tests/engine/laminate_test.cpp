// Elements that hold several layers of skin: a membrane along the skin.

#include <Eigen/Core>
#include <map>
#include <set>

#include "engine/skin/tissue/laminate.h"
#include "engine/step.h"
#include "meshes/layers.h"
#include "meshes/patches.h"
#include "tests/engine/tissue.h"
#include "tests/support.h"

namespace palpate {
namespace {

using testing::block_mesh;
using testing::evaluate_tissue;
using testing::make_chunk;
using testing::scramble;
using testing::symmetric_modes;

/// A block whose elements have membranes alone (their own tissue is a millionth of it), with normals of all directions.
SkinChunk<double> membranes(const TetMesh& mesh, double young, const Pose<double>& pose = Pose<double>::identity(),
                            std::vector<Point> normals = {}, double tissue = 0.03) {
    SkinChunk<double> c;
    allocate_chunk(c, std::make_shared<SkinTopology>(build_topology(mesh, false, 1)), 1, false, false, 1, false, true);
    SkinParameters p;
    p.mesh = &mesh;
    p.young_modulus = {tissue};
    p.membrane_young.assign(mesh.tets.size(), young);
    if (normals.empty())
        for (std::size_t e = 0; e < mesh.tets.size(); ++e)
            normals.push_back({std::sin(double(e)), std::cos(3.0 * double(e)), 0.3});
    p.membrane_normal = normals;
    set_lane(c, 0, 0, p, pose);
    testing::aim_all(c, 2000, 2, pose);
    return c;
}

std::vector<double> gradient_of(const SkinChunk<double>& c) {
    return {c.scratch.gradient.begin(), c.scratch.gradient.begin() + 3 * c.topology->node_count};
}

std::vector<double> matrix_of(const SkinChunk<double>& c) {
    const std::size_t n = 3 * std::size_t(c.topology->node_count);
    std::vector<double> matrix(n * n, 0.0);
    for (const TissuePair& p : tissue_pairs(*c.topology))
        for (std::size_t i = 0; i < 3; ++i)
            for (std::size_t j = 0; j < 3; ++j) {
                const std::size_t row = 3 * std::size_t(p.a) + i, column = 3 * std::size_t(p.b) + j;
                matrix[row * n + column] = matrix[column * n + row] =
                    c.scratch.blocks[9 * std::size_t(p.block) + 3 * i + j];
            }
    return matrix;
}

/// A block whose skin's elements share their stretch in patches; the others have membranes of their own.
TetMesh skinned_block(int nx, int ny, int nz, int size) {
    TetMesh mesh = block_mesh(nx, ny, nz, 0.004);
    make_membrane_patches(mesh, size);
    return mesh;
}

/// By the number of elements that share a stretch; 0: none does.
class MembraneDerivatives : public ::testing::TestWithParam<int> {};
INSTANTIATE_TEST_SUITE_P(Membranes, MembraneDerivatives, ::testing::Values(0, 1, 3, 8));

TEST_P(MembraneDerivatives, ForceIsTheEnergysGradientAndStiffnessTheForces) {
    auto c = membranes(GetParam() > 0 ? skinned_block(2, 2, 1, GetParam()) : block_mesh(2, 1, 1, 0.004), 50e3);
    EXPECT_EQ(c.topology->membrane_patches.empty(), GetParam() == 0);
    scramble(c, 5, 7e-4);
    const std::size_t n = 3 * std::size_t(c.topology->node_count);
    evaluate_tissue(c, 1.0);
    const std::vector<double> gradient = gradient_of(c), matrix = matrix_of(c);
    double largest = 0, stiffest = 0;
    for (double g : gradient) largest = std::max(largest, std::abs(g));
    for (double k : matrix) stiffest = std::max(stiffest, std::abs(k));
    ASSERT_GT(largest, 1e-3);
    const double h = 1e-8;
    for (std::size_t i = 0; i < n && !HasFailure(); ++i) {
        double& x = c.state.position[i];
        const double at = x;
        x = at + h;
        const double above = evaluate_tissue(c, 1.0).energy;
        const auto f_above = gradient_of(c);
        x = at - h;
        const double below = evaluate_tissue(c, 1.0).energy;
        const auto f_below = gradient_of(c);
        x = at;
        EXPECT_NEAR((above - below) / (2 * h), gradient[i], 1e-6 * largest) << i;
        for (std::size_t j = 0; j < n; ++j)
            EXPECT_NEAR((f_above[j] - f_below[j]) / (2 * h), matrix[j * n + i], 1e-5 * stiffest) << i << " " << j;
    }
}

TEST_P(MembraneDerivatives, MatrixWithoutExactnessIsPositive) {
    for (unsigned seed = 1; seed <= 20; ++seed) {
        auto c = membranes(GetParam() > 0 ? skinned_block(2, 1, 1, GetParam()) : block_mesh(1, 1, 1, 0.004), 50e3);
        scramble(c, seed, 3e-3);
        evaluate_tissue(c, 0.0);
        const auto m = matrix_of(c);
        const Eigen::Index n = 3 * c.topology->node_count;
        const Eigen::VectorXd eigenvalues = symmetric_modes(Eigen::Map<const Eigen::MatrixXd>(m.data(), n, n)).values;
        EXPECT_GT(eigenvalues[0], -1e-9 * eigenvalues[n - 1]) << seed;
    }
}

TEST(Membranes, RigidMotionAndWhatHappensAcrossThemCostNothing) {
    const Pose<double> pose{{0.1, -0.2, 0.3}, normalised(Quaternion<double>{0.2, 0.6, 0.8, -0.1})};
    for (const int size : {0, 4}) {
        auto moved = membranes(size > 0 ? skinned_block(2, 2, 2, size) : block_mesh(2, 2, 2, 0.004), 50e3, pose);
        evaluate_tissue(moved, 0);
        for (double f : gradient_of(moved)) EXPECT_LT(std::abs(f), 1e-9 * 50e3 * 0.004 * 0.004);
    }
    // Pressed along z, sheared across it: a membrane whose normal is z does not notice.
    const TetMesh mesh = block_mesh(2, 2, 2, 0.004);
    auto flat = membranes(mesh, 50e3, Pose<double>::identity(), std::vector<Point>(mesh.tets.size(), {0, 0, 1}), 1e-6);
    for (int i = 0; i < flat.topology->node_count; ++i) flat.state.position[std::size_t(3 * i + 2)] *= 0.7;
    evaluate_tissue(flat, 0);
    for (double f : gradient_of(flat)) EXPECT_LT(std::abs(f), 1e-6 * 50e3 * 0.004 * 0.004);
}

TEST(Membranes, AStripOfLayersIsAsStiffAsTheirMeanAlongAndAsInSeriesAcross) {
    // 40 kPa over 10 kPa, half each, in elements that hold both; energies of small strains without Poisson's effect.
    const TetMesh mesh = block_mesh(2, 2, 1, 0.004);
    const double along = 25e3, across = 16e3, size = 0.004, volume = 4 * size * size * size, strain = 1e-3;
    SkinChunk<double> c;
    allocate_chunk(c, std::make_shared<SkinTopology>(build_topology(mesh, false, 1)), 1, false, false, 1, false, true);
    SkinParameters p;
    p.mesh = &mesh;
    p.poisson_ratio = 0;
    p.young_modulus = {across};
    p.membrane_young.assign(mesh.tets.size(), along - across);
    p.membrane_normal.assign(mesh.tets.size(), {0, 0, 1});
    set_lane(c, 0, 0, p, Pose<double>::identity());
    const auto rest = c.state.position;
    for (int axis = 0; axis < 3; ++axis) {
        c.state.position = rest;
        for (std::size_t i = std::size_t(axis); i < rest.size(); i += 3) c.state.position[i] *= 1 + strain;
        const double modulus = evaluate_tissue(c, 0).energy / (0.5 * volume * strain * strain);
        EXPECT_NEAR(modulus, axis == 2 ? across : along, 1e-3 * along) << axis;
    }
}

TEST(Membranes, PatchesOfSkinAreItsFacesAndResistTheirMeanStretchAlone) {
    const TetMesh mesh = skinned_block(4, 4, 2, 4);
    const std::set<int> pad(mesh.pad_nodes.begin(), mesh.pad_nodes.end());
    std::map<int, int> members;
    for (std::size_t e = 0; e < mesh.tets.size(); ++e) {
        const auto on_pad =
            std::count_if(mesh.tets[e].begin(), mesh.tets[e].end(), [&](int i) { return pad.count(i); });
        const bool grouped = mesh.membrane_patches[e] >= 0;
        EXPECT_TRUE(on_pad > 0 || !grouped) << "no face that begins in the pad";
        EXPECT_TRUE(on_pad < 3 || grouped);
        if (mesh.membrane_patches[e] >= 0) ++members[mesh.membrane_patches[e]];
    }
    for (const auto& [patch, count] : members) EXPECT_LE(count, 8);
    EXPECT_ANY_THROW(skinned_block(1, 1, 1, 9));

    // Stretched evenly, patches cost what elements cost alone; moved so that no patch's mean changes, nothing.
    const std::vector<Point> normals(mesh.tets.size(), {0, 0, -1});
    std::vector<double> young;
    for (int patch : mesh.membrane_patches) young.push_back(patch >= 0 ? 50e3 : 0);
    auto chunk = [&](const TetMesh& m) {
        SkinChunk<double> c;
        allocate_chunk(c, std::make_shared<SkinTopology>(build_topology(m, false, 1)), 1, false, false, 1, false, true);
        SkinParameters p;
        p.mesh = &m;
        p.young_modulus = {1e-6};
        p.membrane_young = young;
        p.membrane_normal = normals;
        set_lane(c, 0, 0, p, Pose<double>::identity());
        return c;
    };
    TetMesh alone = mesh;
    alone.membrane_patches.clear();
    auto patched = chunk(mesh), single = chunk(alone);
    for (auto* c : {&patched, &single})
        for (std::size_t i = 0; i < c->state.position.size(); ++i) c->state.position[i] *= i % 3 == 2 ? 1 : 1.01;
    // Faces at the block's sides stand upright, where the skin's normal is said to be another.
    const double even = evaluate_tissue(patched, 0).energy;
    EXPECT_GT(even, 0);
    scramble(patched, 3, 2e-4);
    single.state.position = patched.state.position;
    EXPECT_LT(evaluate_tissue(patched, 0).energy, 0.9 * evaluate_tissue(single, 0).energy) << "Jensen's inequality";
}

TEST(Membranes, AFingerIsTheSameBitsBesideOneWithoutMembranes) {
    const TetMesh mesh = skinned_block(2, 2, 2, 4);
    auto chunk = [&](int width, int lane) {
        SkinChunk<double> c;
        allocate_chunk(c, std::make_shared<SkinTopology>(build_topology(mesh, true, 1)), width, false, false, 1, false,
                       true);
        for (int l = 0; l < width; ++l) {
            SkinParameters p;
            p.mesh = &mesh;
            p.young_modulus = {20e3};
            if (l == lane) p.membrane_young.assign(mesh.tets.size(), 50e3);
            p.membrane_normal.assign(mesh.tets.size(), {0, 0, -1});
            set_lane(c, l, l, p, Pose<double>::identity());
        }
        return c;
    };
    auto alone = chunk(1, 0), beside = chunk(2, 1);
    std::mt19937 random(11);
    std::uniform_real_distribution<double> u(-5e-4, 5e-4);
    for (std::size_t i = 0; i < alone.state.position.size(); ++i) {
        const double by = u(random);
        alone.state.position[i] += by;
        for (std::size_t l = 0; l < 2; ++l) beside.state.position[2 * i + l] += by;
    }
    const auto one = evaluate_tissue(alone, 0.5);
    Evaluation<Lanes<double, 2>> both;
    std::fill(beside.scratch.gradient.begin(), beside.scratch.gradient.end(), 0.0);
    std::fill(beside.scratch.blocks.begin(), beside.scratch.blocks.end(), 0.0);
    detail::add_tissue<detail::Want::forces_and_matrix>(beside, Lanes<double, 2>(0.5), both);
    EXPECT_EQ(one.energy, lane(both.energy, 1));
    EXPECT_GT(lane(both.energy, 1), lane(both.energy, 0));
    for (std::size_t i = 0; i < 3 * mesh.nodes.size(); ++i)
        EXPECT_EQ(alone.scratch.gradient[i], beside.scratch.gradient[2 * i + 1]) << i;
    for (double x : beside.scratch.gradient) ASSERT_TRUE(std::isfinite(x));
}

/// How stiffly membranes bend [N m] per area, and their sum [N/m], of a plate that is stretched as much as it likes.
struct Bending {
    double stiffness, sum;
};
Bending bending_of(const TetMesh& mesh, const std::vector<double>& young, double area) {
    SkinChunk<double> c;
    allocate_chunk(c, std::make_shared<SkinTopology>(build_topology(mesh, false, 1)), 1, false, false, 1, false, true);
    SkinParameters p;
    p.mesh = &mesh;
    p.poisson_ratio = 0;
    p.young_modulus = {1e-6};
    p.membrane_young = young;
    p.membrane_normal.assign(mesh.tets.size(), {0, 0, -1});
    set_lane(c, 0, 0, p, Pose<double>::identity());
    const double curvature = 1e-2;  // strains of some 1e-5
    auto energy = [&](double stretch) {
        for (std::size_t i = 0; i < mesh.nodes.size(); ++i) {
            const Point& x = mesh.nodes[i];
            const double depth = x[2] - mesh.nodes[0][2];
            for (std::size_t d = 0; d < 2; ++d)  // to a bowl
                c.state.position[3 * i + d] = x[d] * (1 + stretch + curvature * depth);
        }
        return evaluate_tissue(c, 0).energy;
    };
    const double e0 = energy(0), up = energy(1e-4), down = energy(-1e-4);
    const double slope = (up - down) / 2e-4, bend = (up - 2 * e0 + down) / 1e-8;
    return {(e0 - slope * slope / (2 * bend)) / (curvature * curvature * area), bend / (2 * area)};
}

TEST(Membranes, AreLiftedUntilTheyBendAsTheirLayersDo) {
    const double skin = 330e3, below = 13e3, thickness = 1e-3;
    for (const double h : {3e-3, 2e-3, 1.2e-3}) {
        const int n = int(12e-3 / h + 0.5);
        TetMesh mesh = block_mesh(n, n, 3, h);
        std::erase_if(mesh.surface, [&](const auto& t) {  // the lower face alone is skin
            return std::any_of(t.begin(), t.end(), [&](int i) { return i % 4 != 0; });
        });
        const LayerShares layers = layer_shares(mesh, {thickness});
        SkinExcess excess = skin_excess(layers.shares, {thickness}, {skin}, below);
        EXPECT_NEAR(excess.variance, thickness * thickness / 12, 1e-12);
        std::vector<double> membranes;
        for (const auto& s : layers.shares)
            membranes.push_back(s[0] * skin + s[1] * below - 1 / (s[0] / skin + s[1] / below));
        excess.of_element = membranes;  // nothing else is stiff along this skin
        const double area = n * h * n * h;
        const Bending before = bending_of(mesh, membranes, area);
        lift_membranes(mesh, layers.normals, excess, membranes);
        const Bending after = bending_of(mesh, membranes, area);
        EXPECT_NEAR(after.sum, before.sum, 1e-6 * before.sum) << h;
        EXPECT_NEAR(after.stiffness, excess.variance * after.sum, 0.25 * excess.variance * after.sum) << h;
        EXPECT_GT(before.stiffness, 2 * after.stiffness) << h;
    }
}

}  // namespace
}  // namespace palpate
