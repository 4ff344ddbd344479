// An independent program as judge: CalculiX solves the same tetrahedra, held at the bone, under the contact forces that
// palpate found; displacements and reactions must agree. Skipped where `ccx` is not installed.

#include <Eigen/Dense>
#include <fstream>
#include <sstream>

#include "engine/step.h"
#include "scenes/finger_mesh.h"
#include "tests/support.h"

namespace palpate {
namespace {

constexpr double young = 30e3, poisson = 0.45;

struct NodalResult {
    std::vector<Vec3<double>> displacement;  ///< bone frame [m]
    std::vector<Vec3<double>> load;          ///< contact force, bone frame [N]
    std::vector<Vec3<double>> reaction;      ///< of the bone, bone frame [N]
};

/// Static press of `depth` [m] on a plane; finger and plane turned together by `turn`.
NodalResult press(const TetMesh& mesh, Material material, double depth, const Quaternion<double>& turn) {
    double lowest = 0;
    for (const Point& p : mesh.nodes) lowest = std::min(lowest, p[2]);
    auto turned = [&](double height) { return Pose<double>{rotation_matrix(turn) * Vec3<double>{0, 0, height}, turn}; };
    SceneSpec spec;
    spec.solver.inertia = false;
    spec.solver.tolerance = 1e-10;
    spec.solver.multiplier_tolerance = 1e-10;
    spec.solver.contact_tolerance = 1e-10;
    FingerSpec finger;
    finger.name = "finger";
    finger.mesh = mesh;
    finger.material = material;
    finger.young_modulus = young;
    finger.poisson_ratio = poisson;
    finger.coupling.stiffness = 1e6;
    finger.coupling.angular_stiffness = 1e4;
    finger.start = turned(-lowest);
    spec.fingers.push_back(finger);
    spec.objects.push_back({"plane", {}, turned(0), 0});
    World world = build_world(spec);
    oneapi::tbb::task_arena arena(1);
    const EntityId id = world.skins.owner(0);
    for (int k = 1; k <= 13; ++k) {
        world.tracker_poses[0].incoming = {turned(-lowest - depth * std::min(1.0, 0.1 * k)), 0.005 * k, true};
        step(world, arena);
    }
    const Pose<double> bone = bone_pose(world, id);
    const Mat3<double> to_bone = transpose(rotation_matrix(bone.rotation));
    NodalResult out;
    const auto now = finger_positions(world, id);
    for (std::size_t i = 0; i < now.size(); ++i) {
        const Vec3<double> rest = transform(bone, Vec3<double>{mesh.nodes[i][0], mesh.nodes[i][1], mesh.nodes[i][2]});
        out.displacement.push_back(to_bone * (Vec3<double>{now[i][0], now[i][1], now[i][2]} - rest));
    }
    out.load.assign(now.size(), {0, 0, 0});
    const ContactSurface& contact = world.contact_surfaces[0];
    for (std::size_t s = 0; s < contact.force.size(); ++s) out.load[mesh.pad_nodes[s]] = to_bone * contact.force[s];
    for (const Vec3<double>& f : bone_reactions(world, id)) out.reaction.push_back(to_bone * f);
    return out;
}

/// The mesh with bone nodes held, under nodal loads: linear, or at large strain (St. Venant-Kirchhoff). Lengths in mm,
/// forces in N, stresses in MPa.
void write_job(const std::filesystem::path& path, const TetMesh& mesh, const std::vector<Vec3<double>>& load,
               bool large_strain) {
    std::ofstream out(path);
    out.precision(12);  // fields of 20 characters: longer ones would lose their exponent
    out << "*NODE, NSET=NALL\n";
    for (std::size_t i = 0; i < mesh.nodes.size(); ++i)
        out << i + 1 << ", " << 1e3 * mesh.nodes[i][0] << ", " << 1e3 * mesh.nodes[i][1] << ", "
            << 1e3 * mesh.nodes[i][2] << "\n";
    out << "*ELEMENT, TYPE=C3D4, ELSET=EALL\n";
    for (std::size_t e = 0; e < mesh.tets.size(); ++e) {
        auto t = mesh.tets[e];
        Eigen::Matrix3d D;
        for (int a = 1; a < 4; ++a)
            for (int d = 0; d < 3; ++d) D(d, a - 1) = mesh.nodes[t[a]][d] - mesh.nodes[t[0]][d];
        if (D.determinant() < 0) std::swap(t[2], t[3]);
        out << e + 1 << ", " << t[0] + 1 << ", " << t[1] + 1 << ", " << t[2] + 1 << ", " << t[3] + 1 << "\n";
    }
    out << "*MATERIAL, NAME=TISSUE\n*ELASTIC\n" << 1e-6 * young << ", " << poisson << "\n";
    out << "*SOLID SECTION, ELSET=EALL, MATERIAL=TISSUE\n*BOUNDARY\n";
    for (int node : mesh.bone_nodes) out << node + 1 << ", 1, 3\n";
    if (large_strain)
        out << "*STEP, NLGEOM, INC=1000\n*CONTROLS, PARAMETERS=FIELD\n1e-9, 1e-7\n*STATIC\n0.1, 1\n*CLOAD\n";
    else
        out << "*STEP\n*STATIC\n*CLOAD\n";
    for (std::size_t i = 0; i < load.size(); ++i)
        for (int d = 0; d < 3; ++d)
            if (load[i][d] != 0) out << i + 1 << ", " << d + 1 << ", " << load[i][d] << "\n";
    out << "*NODE PRINT, NSET=NALL\nU, RF\n*END STEP\n";
}

/// The last table of job.dat (time 1) with `title` in its heading, by node.
std::vector<Vec3<double>> read_table(const std::filesystem::path& path, const std::string& title, std::size_t nodes) {
    std::ifstream in(path);
    std::vector<Vec3<double>> table(nodes, {0, 0, 0});
    std::string line;
    auto is_heading = [&] {
        const auto time = line.find("time");
        return line.find(title) != std::string::npos && time != std::string::npos &&
               std::abs(std::atof(line.c_str() + time + 4) - 1) < 1e-9;
    };
    while (std::getline(in, line) && !is_heading()) {}
    EXPECT_TRUE(in) << "no table of " << title;
    std::size_t rows = 0;
    for (std::getline(in, line); std::getline(in, line) && line.find_first_not_of(" \r") != std::string::npos; ++rows) {
        std::istringstream row(line);
        std::size_t node = 0;
        Vec3<double> v;
        row >> node >> v.x >> v.y >> v.z;
        EXPECT_TRUE(row && node >= 1 && node <= nodes) << line;
        table.at(node - 1) = v;
    }
    EXPECT_EQ(rows, nodes) << title;
    return table;
}

void compare(const TetMesh& mesh, Material material, double depth,
             const Quaternion<double>& turn = Quaternion<double>::identity()) {
    const NodalResult ours = press(mesh, material, depth, turn);
    testing::ScratchFolder scratch;
    write_job(scratch.path / "job.inp", mesh, ours.load, material == Material::saint_venant_kirchhoff);
    const std::string command = "cd " + scratch.path.string() + " && OMP_NUM_THREADS=1 ccx job > log.txt 2>&1";
    ASSERT_EQ(std::system(command.c_str()), 0);
    const std::size_t n = mesh.nodes.size();
    const auto u = read_table(scratch.path / "job.dat", "displacements", n);
    const auto f = read_table(scratch.path / "job.dat", "forces", n);
    double largest_u = 0, largest_f = 0, error_u = 0, error_f = 0;
    for (std::size_t i = 0; i < n; ++i) {
        largest_u = std::max(largest_u, norm(u[i]));
        error_u = std::max(error_u, norm(1e3 * ours.displacement[i] - u[i]));
    }
    for (int i : mesh.bone_nodes) {
        largest_f = std::max(largest_f, norm(f[i]));
        error_f = std::max(error_f, norm(ours.reaction[i] - (f[i] - ours.load[i])));
    }
    EXPECT_GT(largest_u, 1e-7);
    EXPECT_LT(error_u, 1e-5 * largest_u);
    EXPECT_LT(error_f, 1e-4 * largest_f);
    std::printf("displacements agree to %.1e, reactions to %.1e of the largest\n", error_u / largest_u,
                error_f / largest_f);
}

bool calculix_is_installed() { return std::system("command -v ccx > /dev/null 2>&1") == 0; }

TetMesh built_in_finger(int elements) {
    FingerTemplates templates;
    std::string note;
    FingerMeshRequest request;
    request.shape = finger_shape("index");
    request.elements = elements;
    return make_finger_mesh(request, templates, note);
}

constexpr double small = 6e-9;  // [m] strains of about 1e-6, where corotational elasticity is linear

TEST(CalculiX, AgreesAtSmallStrain) {
    if (!calculix_is_installed()) GTEST_SKIP() << "CalculiX is not installed (Debian package calculix-ccx)";
    for (const TetMesh& mesh : {testing::block_mesh(4, 3, 3, 0.004), built_in_finger(347), built_in_finger(1500)})
        compare(mesh, Material::corotational, small);
}

TEST(CalculiX, AgreesAtSmallStrainTurnedBySixtyDegrees) {
    if (!calculix_is_installed()) GTEST_SKIP() << "CalculiX is not installed (Debian package calculix-ccx)";
    const Quaternion<double> turn{std::cos(M_PI / 6), 0.6 * std::sin(M_PI / 6), 0.8 * std::sin(M_PI / 6), 0};
    for (const TetMesh& mesh : {testing::block_mesh(4, 3, 3, 0.004), built_in_finger(347)})
        compare(mesh, Material::corotational, small, turn);
}

TEST(CalculiX, AgreesAtLargeStrain) {
    if (!calculix_is_installed()) GTEST_SKIP() << "CalculiX is not installed (Debian package calculix-ccx)";
    compare(testing::block_mesh(4, 3, 3, 0.004), Material::saint_venant_kirchhoff, 1e-3);
    compare(built_in_finger(347), Material::saint_venant_kirchhoff, 1e-3);
    compare(built_in_finger(1500), Material::saint_venant_kirchhoff, 0.7e-3);
}

}  // namespace
}  // namespace palpate
