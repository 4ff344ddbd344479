// Lanes, singular values, block Cholesky, tables.

#include <oneapi/tbb/global_control.h>

#include <cstring>

#include "engine/ecs/table.h"
#include "engine/math/gather.h"
#include "engine/math/svd3.h"
#include "engine/skin/factor/supernode_threads.h"
#include "engine/skin/solve/progress.h"
#include "engine/skin/tissue/isotropic.h"
#include "tests/engine/matrices.h"
#include "tests/support.h"

namespace palpate {
namespace {

using testing::eigen;
using testing::random_matrix;

void check_svd(const Mat3<double>& F) {
    const auto svd = signed_svd(F);
    const Eigen::Matrix3d U = eigen(svd.U), V = eigen(svd.V),
                          S = Eigen::Vector3d(svd.sigma.x, svd.sigma.y, svd.sigma.z).asDiagonal();
    const double size = eigen(F).norm() + 1e-300;
    EXPECT_LT((U.transpose() * U - Eigen::Matrix3d::Identity()).norm(), 1e-12);
    EXPECT_LT((V.transpose() * V - Eigen::Matrix3d::Identity()).norm(), 1e-12);
    EXPECT_NEAR(U.determinant(), 1, 1e-12);
    EXPECT_NEAR(V.determinant(), 1, 1e-12);
    EXPECT_LT((U * S * V.transpose() - eigen(F)).norm(), 1e-13 * size);
    EXPECT_GE(svd.sigma.x, svd.sigma.y * (1 - 1e-12));
    EXPECT_GE(svd.sigma.y, std::abs(svd.sigma.z) * (1 - 1e-12) - 1e-15 * size);
}

TEST(Svd, RandomMatricesOfBothSigns) {
    std::mt19937 random(1);
    for (int i = 0; i < 20000; ++i) check_svd(random_matrix(random));
}

TEST(Svd, DegenerateMatrices) {
    std::mt19937 random(2);
    check_svd(Mat3<double>::zero());
    check_svd(Mat3<double>::identity());
    check_svd(-1.0 * Mat3<double>::identity());
    for (int i = 0; i < 2000; ++i) {
        const auto a = signed_svd(random_matrix(random));
        for (Vec3<double> s : {Vec3<double>{1, 1, 1},
                               {1, 1, -1},
                               {2, 1, 1},
                               {2, 2, 1},
                               {1, 0, 0},
                               {1, 1, 0},
                               {1, 1e-6, 1e-12},
                               {1e6, 1, 1e-6},
                               {1e-150, 1e-151, 0},
                               {1e150, 1, -1}})
            check_svd(principal_to_matrix(a, s));
    }
}

TEST(Svd, LanesAgreeWithScalarBitForBit) {
    using R = Lanes<double, 2>;
    std::mt19937 random(3);
    for (int i = 0; i < 2000; ++i) {
        const Mat3<double> a = random_matrix(random), b = random_matrix(random);
        Mat3<R> both;
        for (int k = 0; k < 9; ++k)
            set_lane(both.m[k / 3][k % 3], 0, a.m[k / 3][k % 3]), set_lane(both.m[k / 3][k % 3], 1, b.m[k / 3][k % 3]);
        const auto lanes = signed_svd(both);
        const auto sa = signed_svd(a), sb = signed_svd(b);
        for (int k = 0; k < 3; ++k) {
            EXPECT_EQ(lane(lanes.sigma[k], 0), sa.sigma[k]);
            EXPECT_EQ(lane(lanes.sigma[k], 1), sb.sigma[k]);
        }
    }
}

/// A random definite matrix and its pattern.
struct RandomSystem {
    static constexpr int size = 40;
    BlockPattern pattern;
    Eigen::MatrixXd A = Eigen::MatrixXd::Zero(3 * size, 3 * size);
    LaneArray<double> blocks;
};
RandomSystem random_system(std::mt19937& random) {
    constexpr int size = RandomSystem::size;
    RandomSystem s;
    std::uniform_int_distribution<int> pick(0, size - 1);
    std::normal_distribution<double> n;
    std::vector<std::vector<int>> adjacency(size);
    for (int k = 0; k < 90; ++k) {
        const int a = pick(random), b = pick(random);
        if (a == b) continue;
        adjacency[a].push_back(b);
        adjacency[b].push_back(a);
    }
    s.pattern = factor_pattern(adjacency);
    add_updates(s.pattern);
    s.blocks.resize(9 * std::size_t(s.pattern.block_count));
    for (int i = 0; i < size; ++i) {
        for (int j : adjacency[i])
            if (j < i) s.A.block<3, 3>(3 * i, 3 * j) = Eigen::Matrix3d::NullaryExpr([&] { return n(random); });
        s.A.block<3, 3>(3 * i, 3 * i) = 60 * Eigen::Matrix3d::Identity();
    }
    s.A = Eigen::MatrixXd(s.A.selfadjointView<Eigen::Lower>());
    for (int i = 0; i < size; ++i)
        for (int j = 0; j <= i; ++j) {
            const int b = s.pattern.find(i, j);
            if (b < 0) continue;
            for (int k = 0; k < 9; ++k) s.blocks[9 * b + k] = s.A(3 * i + k / 3, 3 * j + k % 3);
        }
    return s;
}

TEST(BlockCholesky, SolvesARandomSystem) {
    std::mt19937 random(4);
    std::normal_distribution<double> n;
    constexpr int size = RandomSystem::size;
    const auto [pattern, A, blocks] = random_system(random);
    Eigen::VectorXd right = Eigen::VectorXd::NullaryExpr(3 * size, [&] { return n(random); });
    LaneArray<double> x(right.data(), right.data() + right.size());
    const SupernodeFactor f = build_supernodes(pattern);
    LaneArray<double> panels(f.panel_scalars, 0.0), work(f.work_scalars, 0.0), y = x;
    EXPECT_EQ(factor_supernodes<double>(f, pattern, blocks.data(), panels.data(), work.data()), 0);
    solve_supernodes<double>(f, panels.data(), y.data(), work.data());
    LaneArray<double> factor(blocks.size(), 0.0);
    EXPECT_EQ(factor_blocks<double>(pattern, blocks.data(), factor.data()), 0);
    solve_blocks<double>(pattern, factor.data(), x.data());
    EXPECT_LT((A * Eigen::Map<Eigen::VectorXd>(x.data(), 3 * size) - right).norm(), 1e-11 * right.norm());
    EXPECT_EQ(x, y);  // to the last bit
}

/// What a few changed blocks leave as it was is not factored again, and the factor is the same to the last bit.
TEST(BlockCholesky, FactorsWhatFollowsOfChangedColumnsAlone) {
    std::mt19937 random(5);
    for (int trial = 0; trial < 20; ++trial) {
        RandomSystem s = random_system(random);
        const SupernodeFactor f = build_supernodes(s.pattern);
        LaneArray<double> panels(f.panel_scalars, 0.0), work(f.work_scalars, 0.0), factor(s.blocks.size(), 0.0);
        factor_supernodes<double>(f, s.pattern, s.blocks.data(), panels.data(), work.data());
        factor_blocks<double>(s.pattern, s.blocks.data(), factor.data());
        std::vector<unsigned char> changed(RandomSystem::size, 0);
        for (int k = 0; k < 3; ++k) {
            const int column = std::uniform_int_distribution<int>(0, RandomSystem::size - 1)(random);
            for (int i = 0; i < 9; i += 4) s.blocks[9 * std::size_t(s.pattern.find(column, column)) + i] += 7;
            changed[column] = 1;
        }
        mark_ancestors(s.pattern, changed.data());
        auto factored = [&](const unsigned char* columns, LaneArray<double> to_panels, LaneArray<double> to_factor) {
            factor_supernodes<double>(f, s.pattern, s.blocks.data(), to_panels.data(), work.data(), columns);
            factor_blocks<double>(s.pattern, s.blocks.data(), to_factor.data(), columns);
            return std::make_pair(to_panels, to_factor);
        };
        EXPECT_EQ(factored(changed.data(), panels, factor), factored(nullptr, panels, factor));
        // Columns that are not marked are not touched.
        const std::vector<unsigned char> none(RandomSystem::size, 0);
        EXPECT_EQ(factored(none.data(), panels, factor), std::make_pair(panels, factor));
    }
}

/// Supernodes by several threads: all of them, then those of changed columns.
TEST(BlockCholesky, SolvesWithTheSameBitsByAnyNumberOfThreads) {
    const oneapi::tbb::global_control five_threads(oneapi::tbb::global_control::max_allowed_parallelism, 5);
    std::mt19937 random(6);
    for (int trial = 0; trial < 50; ++trial) {
        RandomSystem s = random_system(random);
        SupernodeFactor f = build_supernodes(s.pattern);
        f.workers = SupernodeFactor::most_workers;
        const std::vector<unsigned char> all(RandomSystem::size, 1);
        std::vector<unsigned char> changed(RandomSystem::size, 0);
        const int column = trial % RandomSystem::size;
        changed[std::size_t(column)] = 1;
        mark_ancestors(s.pattern, changed.data());
        LaneArray<double> blocks = s.blocks;
        blocks[9 * std::size_t(s.pattern.find(column, column))] = trial % 3 == 0 ? -1 : 90;  // no pivot, or another
        std::vector<LaneArray<double>> solutions;
        double bad_pivots = -1;
        for (int count = 0; count <= 5; ++count) {  // 0: alone
            Threads threads(std::max(1, count));
            LaneArray<double> panels(f.panel_scalars, 0.0), work(panel_work_scalars(f), 0.0);
            std::vector<int> done(f.supernodes.size());
            auto factor = [&](const LaneArray<double>& from, const std::vector<unsigned char>& marks) {
                return count == 0 ? factor_supernodes<double>(f, s.pattern, from.data(), panels.data(), work.data(),
                                                              marks.data())
                                  : factor_supernodes_together<double>(f, s.pattern, from.data(), panels.data(),
                                                                       work.data(), marks.data(), done, threads);
            };
            auto solve = [&] {
                LaneArray<double>& x = solutions.emplace_back(3 * RandomSystem::size, 1.0);
                solve_supernodes<double>(f, panels.data(), x.data(), work.data());
            };
            EXPECT_EQ(factor(s.blocks, all), 0);
            solve();
            const double bad = factor(blocks, changed);
            if (count == 0) bad_pivots = bad;
            EXPECT_EQ(bad, bad_pivots);
            EXPECT_EQ(bad > 0, trial % 3 == 0);
            solve();
            EXPECT_NE(solutions[0], solutions[1]);
            for (std::size_t k : {0, 1})  // bits: without a pivot there may be no number
                EXPECT_EQ(0, std::memcmp(solutions[solutions.size() - 2 + k].data(), solutions[k].data(),
                                         solutions[k].size() * sizeof(double)))
                    << count;
        }
    }
}

TEST(BlockCholesky, CountsPivotsThatAreNotPositive) {
    BlockPattern pattern = factor_pattern({{}});
    add_updates(pattern);
    LaneArray<double> block{1, 0, 0, 0, -1, 0, 0, 0, 1};
    LaneArray<double> factor(9, 0.0);
    EXPECT_EQ(factor_blocks<double>(pattern, block.data(), factor.data()), 1);
    for (double x : factor) EXPECT_TRUE(std::isfinite(x));
}

TEST(LineSearch, EndsAtTheLowestPointOfAParabolaAndIsTakenBackWhereThatIsHigherStill) {
    // Energy along the step: -a until a limit wakes, which is at once, then 500 a^2 more: lowest at a = 0.001.
    auto energy = [](double a, double stiffness) { return -a + stiffness * a * a; };
    for (const bool parabola : {true, false}) {
        auto p = detail::begin_progress<double>(true);
        p.base_energy = 0, p.base_residual = 1, p.slope = -1, p.alpha = 1;
        Evaluation<double> e;
        e.residual = 2;  // no better, either
        int tried = 0;
        for (; tried < 20; ++tried) {
            // What rises otherwise than it seemed is of no use there.
            e.energy = parabola || p.alpha > 0.01 ? energy(p.alpha, 500) : std::sqrt(p.alpha);
            if (p.alpha == 0) e.energy = 0;
            const auto d = detail::decide<double>(e, 0, {}, p);
            if (!d.retry) break;
            detail::shorten_steps<double>(p, d, e);
        }
        EXPECT_EQ(tried, parabola ? 7 : 8);
        EXPECT_NEAR(p.alpha, parabola ? 0.001 : 0, 1e-12);
        EXPECT_EQ(p.uphill, parabola ? 0 : 1);
        EXPECT_FALSE(p.failed);
    }
}

TEST(Lanes, ArithmeticAndMasks) {
    using R = Lanes<float, 4>;
    R a(2);
    for (int i = 0; i < 4; ++i) set_lane(a, i, float(i));
    const R b = select(a > R(1), a * R(2), -a);
    EXPECT_EQ(lane(b, 0), 0);
    EXPECT_EQ(lane(b, 1), -1);
    EXPECT_EQ(lane(b, 3), 6);
    EXPECT_EQ(bits_from_mask<R>(a >= R(2)), 0b1100u);
    EXPECT_EQ(bits_from_mask<R>(mask_from_bits<R>(0b0110)), 0b0110u);
    set_lane(a, 2, std::numeric_limits<float>::quiet_NaN());
    EXPECT_EQ(bits_from_mask<R>(finite(a)), 0b1011u);
    EXPECT_EQ(lane(square_root(R(9)), 1), 3);
}

template <class Whole>
void expect_triples_as_in_memory() {
    using T = ScalarOf<Whole>;
    constexpr int n = lane_width<Whole>;
    LaneArray<T> memory(60);
    for (std::size_t i = 0; i < memory.size(); ++i) memory[i] = T(i);
    std::size_t offset[n];
    for (int k = 0; k < n; ++k) offset[k] = k == 1 ? 57 : std::size_t(7 * k % 50);  // the last three, too
    Whole x[3];
    gather_triples(memory.data(), offset, x);
    for (int i = 0; i < 3; ++i)
        for (int k = 0; k < n; ++k)
            EXPECT_EQ(lane(x[i], k), memory[offset[k] + std::size_t(i)])
                << n << " parts, number " << i << " of part " << k;
}
TEST(Lanes, TriplesAreGatheredAsTheyStandInMemory) {
    expect_triples_as_in_memory<Lanes<float, 8, 256>>();
    expect_triples_as_in_memory<Lanes<float, 16, 512>>();
    expect_triples_as_in_memory<Lanes<double, 4, 256>>();
    expect_triples_as_in_memory<Lanes<double, 8, 512>>();
}

TEST(Tables, IdsAreInvalidAfterDestructionAndRowsStayDense) {
    EntityPool pool;
    Table<int> table;
    const EntityId a = pool.create(), b = pool.create(), c = pool.create();
    table.add(a, 1), table.add(b, 2), table.add(c, 3);
    EXPECT_TRUE(table.remove(a));
    pool.destroy(a);
    EXPECT_FALSE(pool.alive(a));
    const EntityId d = pool.create();
    EXPECT_EQ(d.index, a.index);
    EXPECT_NE(d.generation, a.generation);
    EXPECT_EQ(table.find(a), nullptr);
    EXPECT_EQ(table.find(d), nullptr);
    EXPECT_EQ(*table.find(b), 2);
    EXPECT_EQ(*table.find(c), 3);
    EXPECT_EQ(table.size(), 2u);
    EXPECT_EQ(table.find(EntityId{}), nullptr);
}

}  // namespace
}  // namespace palpate
