// Contact against a closed form: a rigid sphere pressed into a deep elastic block (Hertz 1882).

#include "engine/contact/contact_edge.h"
#include "tests/support.h"

namespace palpate {
namespace {

constexpr double block_young = 30e3, block_poisson = 0.3, contact_radius = 1e-3, sphere_radius = 0.1;

/// Distance from the middle after `cells` cells: equal ones up to the contact's rim, growing ones beyond.
double graded(double cells, int fine) {
    const double h = contact_radius / fine, inner = std::ceil(1.25 * fine), growth = 1.5;
    if (cells <= inner) return cells * h;
    return h * (inner + growth * (std::pow(growth, cells - inner) - 1) / (growth - 1));
}

/// A block whose bottom touches z = 0, refined around the origin: `fine` cells across the contact's radius.
TetMesh half_space(int fine) {
    int cells = 0;
    while (graded(cells, fine) < 15 * contact_radius) ++cells;
    TetMesh mesh = testing::block_mesh(2 * cells, 2 * cells, cells, 1);
    for (Point& p : mesh.nodes) {
        for (int d : {0, 1}) p[d] = std::copysign(graded(std::abs(p[d]), fine), p[d]);
        p[2] = graded(p[2] + 0.5 * cells, fine);
    }
    return mesh;
}

constexpr double depth = contact_radius * contact_radius / sphere_radius;
const Shape shape{ShapeKind::sphere, {sphere_radius, 0, 0}};
const Pose<double> sphere{{0, 0, depth - sphere_radius}, Pose<double>::identity().rotation};

/// Solves the block under the sphere, at rest.
void press_sphere(SkinChunk<double>& chunk) {
    testing::touch_all(chunk, {0, shape, sphere, Pose<double>::identity(), 0});
    testing::aim_all(chunk, 1e7, 1e5, Pose<double>::identity());
    SolverSettings s;
    s.inertia = false;
    s.contact_tolerance = 1e-9;
    for (int i = 0; i < 3 && !(i > 0 && chunk.status[0].converged); ++i) solve_skin(chunk, s);
    EXPECT_TRUE(chunk.status[0].converged);
}

struct Indentation {
    double force, peak_pressure;
    double depth, level;  ///< how much deeper the sphere's top went than the point of the axis at height `level`
};

Indentation indent(int fine) {
    const TetMesh mesh = half_space(fine);
    auto chunk = testing::make_chunk<double>(mesh, Pose<double>::identity(),
                                             {.limits = false, .young = block_young, .poisson = block_poisson});
    press_sphere(chunk);
    Indentation out{chunk.status[0].contact_force_N, 0, 0, 0};
    const double h = contact_radius / fine;
    auto on_axis = [&](int i) { return std::abs(mesh.nodes[i][0]) + std::abs(mesh.nodes[i][1]) < 1e-9; };
    for (int i = 0; i < int(mesh.nodes.size()); ++i)
        if (on_axis(i) && mesh.nodes[i][2] < 7 * contact_radius && mesh.nodes[i][2] > out.level) {
            out.level = mesh.nodes[i][2];
            out.depth = depth - (chunk.state.position[3 * i + 2] - out.level);
        }
    for (std::size_t i = 0; i < mesh.pad_nodes.size(); ++i)
        if (on_axis(mesh.pad_nodes[i])) out.peak_pressure = chunk.state.normal_multiplier[i] / (h * h);
    return out;
}

/// What theory says for a half-space: the force at which the sphere's top has come `depth` nearer to the point of the
/// axis at `level`, which itself moves as under a point load.
double force_of(double depth, double level) {
    const double modulus = block_young / (1 - block_poisson * block_poisson);
    double force = 0;
    for (int i = 0; i < 100; ++i) {
        const double carried = force * (1 + block_poisson) * (3 - 2 * block_poisson) / (2 * M_PI * block_young * level);
        force = 4.0 / 3 * modulus * std::sqrt(sphere_radius) * std::pow(depth + carried, 1.5);
    }
    return force;
}

TEST(Hertz, SphereOnADeepBlock) {
    const double modulus = block_young / (1 - block_poisson * block_poisson);
    double last_force = 1, last_pressure = 1;
    for (int fine : {2, 3, 4}) {
        if (fine == 4 && !testing::is_tried(1, 2)) break;
        const Indentation found = indent(fine);
        const double force = found.force / force_of(found.depth, found.level) - 1;
        const double peak = std::cbrt(6 * found.force * modulus * modulus / (sphere_radius * sphere_radius)) / M_PI;
        const double pressure = found.peak_pressure / peak - 1;
        std::printf("%d cells across the contact's radius: force %+.1f %%, peak pressure %+.1f %%\n", fine, 100 * force,
                    100 * pressure);
        EXPECT_LT(std::abs(force), last_force);
        EXPECT_LT(std::abs(pressure), last_pressure);
        last_force = std::abs(force), last_pressure = std::abs(pressure);
    }
    EXPECT_LT(last_force, 0.05);
    EXPECT_LT(last_pressure, 0.05);
}

/// Corners of a grid of equal cells in the middle, growing ones beyond, moved by a share of a cell.
TetMesh moved_half_space(int fine, double along_x, double along_y) {
    TetMesh mesh = half_space(fine);
    const double h = contact_radius / fine;
    for (Point& p : mesh.nodes) p[0] += along_x * h, p[1] += along_y * h;
    return mesh;
}

/// The pad of a block as the world would have it: pressed forces at nodes, gaps beside them.
ContactSurface surface_of(const TetMesh& mesh, const SkinChunk<double>& chunk) {
    ContactSurface c;
    c.modulus = block_young / (1 - block_poisson * block_poisson);
    const std::vector<double> area = nodal_areas(mesh);
    std::vector<int> sample(mesh.nodes.size(), -1);
    for (int node : mesh.pad_nodes) {
        const auto s = std::size_t(c.position.size()), n = std::size_t(node);
        sample[n] = int(s);
        const Vec3<double> x = node_position(chunk, node, 0);
        c.position.push_back(x);
        c.area.push_back(area[n]);
        const double force = chunk.state.normal_multiplier[s];
        c.touches.push_back(force > 0);
        c.pressing.push_back({0, 0, force});
        c.gap.push_back(force > 0 ? 0 : std::max(0.0, surface_point(shape, sphere, x).distance));
    }
    for (const auto& f : mesh.surface) {
        const std::array<int, 3> samples{sample[std::size_t(f[0])], sample[std::size_t(f[1])],
                                         sample[std::size_t(f[2])]};
        if (samples[0] >= 0 && samples[1] >= 0 && samples[2] >= 0) c.faces.push_back(samples);
    }
    return c;
}

struct AreaErrors {
    double mean = 0, worst = 0, worst_of_nodes = 0;
};
/// Areas under a sphere in several places of a mesh, against a circle whose radius follows from the force.
AreaErrors areas(int fine) {
    AreaErrors out;
    constexpr int count = 6;
    const double modulus = block_young / (1 - block_poisson * block_poisson);
    for (int k = 0; k < count; ++k) {
        const double x = 0.5 * k / (count - 1), y = 0.31 * k / (count - 1);  // from on a node to between nodes
        const TetMesh mesh = moved_half_space(fine, x, y);
        auto chunk = testing::make_chunk<double>(mesh, Pose<double>::identity(),
                                                 {.limits = false, .young = block_young, .poisson = block_poisson});
        press_sphere(chunk);
        const double force = chunk.status[0].contact_force_N;
        const double circle = M_PI * std::pow(0.75 * force * sphere_radius / modulus, 2.0 / 3);
        const ContactSurface c = surface_of(mesh, chunk);
        double nodes = 0;
        for (std::size_t i = 0; i < c.area.size(); ++i) nodes += c.touches[i] ? c.area[i] : 0;
        const double error = area_in_contact(c) / circle - 1;
        out.mean += error / count;
        out.worst = std::max(out.worst, std::abs(error));
        out.worst_of_nodes = std::max(out.worst_of_nodes, std::abs(nodes / circle - 1));
    }
    return out;
}

TEST(Hertz, AreaBetweenNodes) {
    const double mean_bound[] = {0, 0.04, 0.02}, worst_bound[] = {0, 0.30, 0.08};
    for (int fine : {1, 2}) {
        if (!testing::is_tried(fine - 1, 2)) continue;
        const AreaErrors found = areas(fine);
        std::printf(
            "%d cells across the contact's radius: area %+.1f %% in the mean, at most %.1f %% off; whole nodes "
            "%.0f %%\n",
            fine, 100 * found.mean, 100 * found.worst, 100 * found.worst_of_nodes);
        EXPECT_LT(std::abs(found.mean), mean_bound[fine]);
        EXPECT_LT(found.worst, worst_bound[fine]);
        EXPECT_GT(found.worst_of_nodes, 2 * found.worst);
    }
}

}  // namespace
}  // namespace palpate
