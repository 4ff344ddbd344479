// A stiffer nodule in a soft slab, felt by pressing: CalculiX, on a mesh of its own, is the judge. Skipped where `ccx`
// is not installed.

#include <cstdio>
#include <fstream>

#include "meshes/object_mesh.h"
#include "scenes/load/scene.h"
#include "scenes/run/simulation.h"
#include "tests/support.h"

namespace palpate {
namespace {

// [mm], [kPa]
constexpr double half[3] = {18, 12, 6}, nodule_at[3] = {-9, 0, 0.8}, nodule_radius = 4, sphere_radius = 20, depth = 1;
constexpr double young = 10, nodule_young = 100, poisson = 0.45;

/// Force on a rigid sphere pressed into the slab at a place along it, in static equilibrium [N].
double pressed(double x, int elements) {
    char text[1200];
    std::snprintf(text, sizeof text,
                  "duration_s = 1\ndt_ms = 5\n[solver]\nstatic = true\nsample_refinement = 3\n"
                  "[[object]]\nname = \"slab\"\nkind = \"box\"\nsize_mm = [%g, %g, %g]\n"
                  "[object.soft]\nyoung_kPa = %g\npoisson = %g\nelements = %d\nfixed = \"bottom\"\n"
                  "nodule = [ { centre_mm = [%g, %g, %g], radius_mm = %g, young_kPa = %g } ]\n"
                  "[[object]]\nname = \"sphere\"\nkind = \"sphere\"\nradius_mm = %g\n"
                  "track = [ { t_s = 0, position_mm = [%g, 0, %g] }, { t_s = 0.05, position_mm = [%g, 0, %g] } ]\n"
                  "[[finger]]\nfinger = \"index-median\"\ntrack = [ { t_s = 0, position_mm = [0, 0, 200] } ]\n",
                  2 * half[0], 2 * half[1], 2 * half[2], young, poisson, elements, nodule_at[0], nodule_at[1],
                  nodule_at[2], nodule_radius, nodule_young, sphere_radius, x, half[2] + sphere_radius + 0.01, x,
                  half[2] + sphere_radius - depth);
    Simulation s = make_simulation(load_scene_text(text, "nodule.toml"), 1);
    for (int k = 0; k < 14; ++k) advance(s);
    const SoftObject& o = s.world.soft.all[0];
    EXPECT_TRUE(s.world.chunks.doubles[std::size_t(o.skin.chunk)].status[0].converged);
    return o.surface.normal_force;
}

/// The same by CalculiX: linear tetrahedra, a sphere of held wedges, contact of nodes with faces. Lengths in mm,
/// stresses in MPa.
double judged(double x, int elements, const std::filesystem::path& folder) {
    const Point size{1e-3 * half[0], 1e-3 * half[1], 1e-3 * half[2]};
    const Inclusion nodule{{1e-3 * nodule_at[0], 1e-3 * nodule_at[1], 1e-3 * nodule_at[2]}, 1e-3 * nodule_radius};
    const ObjectMesh slab = mesh_object([&](double edge) { return box_surface(size, edge); },
                                        8 * size[0] * size[1] * size[2], {nodule}, {.elements = elements});
    std::ofstream out(folder / "job.inp");
    out.precision(12);
    const std::size_t n = slab.mesh.nodes.size();
    out << "*NODE, NSET=NSLAB\n";
    for (std::size_t i = 0; i < n; ++i)
        out << i + 1 << ", " << 1e3 * slab.mesh.nodes[i][0] << ", " << 1e3 * slab.mesh.nodes[i][1] << ", "
            << 1e3 * slab.mesh.nodes[i][2] << "\n";
    for (const bool in : {false, true}) {
        out << "*ELEMENT, TYPE=C3D4, ELSET=" << (in ? "ENODULE" : "ESLAB") << "\n";
        for (std::size_t e = 0; e < slab.mesh.tets.size(); ++e) {
            if ((slab.inclusion[e] >= 0) != in) continue;
            out << e + 1;
            for (int node : slab.mesh.tets[e]) out << ", " << node + 1;
            out << "\n";
        }
    }
    // The part of the sphere that can touch, as wedges between it and a smaller one.
    const Surface ball = capsule_surface(1e-3 * sphere_radius, 0, 0.04 * 1e-3 * sphere_radius);
    const std::size_t count = ball.vertices.size();
    out << "*NODE, NSET=NSPHERE\n";
    for (const double share : {0.8, 1.0})
        for (std::size_t i = 0; i < count; ++i) {
            const Point& p = ball.vertices[i];
            const double length = std::hypot(p[0], p[1], p[2]), r = share * sphere_radius / length;
            out << n + (share < 1 ? 0 : count) + i + 1 << ", " << x + r * p[0] << ", " << r * p[1] << ", "
                << half[2] + sphere_radius + r * p[2] << "\n";
        }
    out << "*ELEMENT, TYPE=C3D6, ELSET=ESPHERE\n";
    std::vector<std::size_t> wedges;
    for (const auto& t : ball.triangles) {
        if (ball.vertices[std::size_t(t[0])][2] > -0.8e-3 * sphere_radius) continue;
        wedges.push_back(slab.mesh.tets.size() + wedges.size() + 1);
        out << wedges.back();
        for (const std::size_t layer : {std::size_t(0), count})
            for (int i : t) out << ", " << n + layer + std::size_t(i) + 1;
        out << "\n";
    }
    for (const auto& [name, E] : {std::pair{"SLAB", young}, {"NODULE", nodule_young}, {"SPHERE", 1000.0}})
        out << "*MATERIAL, NAME=" << name << "\n*ELASTIC\n"
            << 1e-3 * E << ", " << poisson << "\n*SOLID SECTION, ELSET=E" << name << ", MATERIAL=" << name << "\n";
    out << "*NSET, NSET=TOP\n";
    for (std::size_t i = 0; i < n; ++i)
        if (slab.mesh.nodes[i][2] > size[2] - 1e-9) out << i + 1 << "\n";
    out << "*NSET, NSET=BOTTOM\n";
    for (std::size_t i = 0; i < n; ++i)
        if (slab.mesh.nodes[i][2] < -size[2] + 1e-9) out << i + 1 << "\n";
    out << "*SURFACE, NAME=STOP, TYPE=NODE\nTOP\n*SURFACE, NAME=SSPHERE\n";
    for (std::size_t e : wedges) out << e << ", S2\n";
    out << "*SURFACE INTERACTION, NAME=TOUCH\n*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR\n20, 1e-6\n"
        << "*CONTACT PAIR, INTERACTION=TOUCH, TYPE=NODE TO SURFACE\nSTOP, SSPHERE\n"
        << "*BOUNDARY\nBOTTOM, 1, 3\n*STEP, INC=200\n*STATIC\n0.25, 1\n*BOUNDARY\nNSPHERE, 1, 2\nNSPHERE, 3, 3, "
        << -depth << "\n*NODE PRINT, NSET=BOTTOM, TOTALS=ONLY\nRF\n*END STEP\n";
    out.close();
    const std::string command = "cd " + folder.string() + " && OMP_NUM_THREADS=2 ccx job > log.txt 2>&1";
    EXPECT_EQ(std::system(command.c_str()), 0);
    std::ifstream in(folder / "job.dat");
    double fx = 0, fy = 0, fz = 0;
    for (std::string line; std::getline(in, line);)
        if (line.find("total force") != std::string::npos) {
            std::getline(in, line);
            in >> fx >> fy >> fz;
        }
    std::printf("CalculiX, %zu elements, at %g mm: %.5f N\n", slab.mesh.tets.size(), x, fz);
    return fz;
}

TEST(Nodule, IsFeltAsCalculiXSays) {
    if (std::system("command -v ccx > /dev/null 2>&1") != 0)
        GTEST_SKIP() << "CalculiX is not installed (Debian package calculix-ccx)";
    testing::ScratchFolder scratch;
    const int fine = 40000;
    const double over = judged(nodule_at[0], fine, scratch.path), beside = judged(-nodule_at[0], fine, scratch.path);
    ASSERT_GT(beside, 0.01);
    EXPECT_GT(over, 1.5 * beside);
    double excess = 1;  // of the force beside the nodule; coarse linear tetrahedra are too stiff
    for (const int elements : {1000, 4000}) {
        const double here = pressed(nodule_at[0], elements), there = pressed(-nodule_at[0], elements);
        std::printf("%d: over %.5f N (%+.1f %%), beside %.5f N (%+.1f %%), ratio %.4f (%+.1f %%)\n", elements, here,
                    100 * (here / over - 1), there, 100 * (there / beside - 1), here / there,
                    100 * (here / there / (over / beside) - 1));
        EXPECT_NEAR(here / there, over / beside, 0.05 * over / beside);
        EXPECT_LT(there / beside - 1, 0.7 * excess);
        excess = there / beside - 1;
    }
}

}  // namespace
}  // namespace palpate
