// An independent program as judge: CalculiX solves the same tetrahedra, held at the bone, under the contact forces that
// palpate found; displacements and reactions must agree. Skipped where `ccx` is not installed.

#include <Eigen/Dense>
#include <fstream>
#include <sstream>

#include "engine/step.h"
#include "scenes/load/finger_mesh.h"
#include "tests/support.h"

namespace palpate {
namespace {

constexpr double young = 30e3, poisson = 0.45;

struct NodalResult {
    std::vector<Vec3<double>> displacement;  ///< bone frame [m]
    std::vector<Vec3<double>> load;          ///< contact force, bone frame [N]
    std::vector<Vec3<double>> reaction;      ///< of the bone, bone frame [N]
    Pose<double> plane;                      ///< in the bone frame
};

/// A stiff plate under the finger, as eight held nodes.
struct Plate {
    std::array<Vec3<double>, 8> corner, displacement;  ///< [m]
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
    finger.coupling.max_torque = 1e4;
    finger.start = turned(-lowest);
    spec.fingers.push_back(finger);
    spec.objects.push_back({"plane", {}, turned(0), 0});
    World world = build_world(spec);
    Threads threads(1);
    const EntityId id = world.skins.owner(0);
    for (int k = 1; k <= 13; ++k) {
        world.tracker_poses[0].incoming = {turned(-lowest - depth * std::min(1.0, 0.1 * k)), 0.005 * k, true};
        step(world, threads);
    }
    const Pose<double> bone = bone_pose(world, id);
    const Mat3<double> to_bone = transpose(rotation_matrix(bone.rotation));
    NodalResult out;
    out.plane = {to_bone * (turned(0).position - bone.position), normalised(conjugate(bone.rotation) * turn)};
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

/// The plate that touches the finger's lowest node first, and then moves to where the plane is.
Plate plate_under(const TetMesh& mesh, const Pose<double>& plane) {
    double lowest = 0, reach = 0;
    for (const Point& p : mesh.nodes)
        lowest = std::min(lowest, p[2]), reach = std::max({reach, p[0], -p[0], p[1], -p[1]});
    Plate plate;
    for (int i = 0; i < 8; ++i) {
        const double x = i % 4 == 1 || i % 4 == 2 ? 2 : -2, y = i % 4 >= 2 ? 2 : -2, z = i < 4 ? -1 : 0;
        const Vec3<double> in_plane = reach * Vec3<double>{x, y, z};
        plate.corner[i] = in_plane + Vec3<double>{0, 0, lowest};
        plate.displacement[i] = transform(plane, in_plane) - plate.corner[i];
    }
    return plate;
}

void write_plate(std::ofstream& out, const TetMesh& mesh, const Plate& plate) {
    const std::size_t n = mesh.nodes.size(), e = mesh.tets.size();
    out << "*NODE, NSET=NPLATE\n";
    for (int i = 0; i < 8; ++i)
        out << n + 1 + i << ", " << 1e3 * plate.corner[i].x << ", " << 1e3 * plate.corner[i].y << ", "
            << 1e3 * plate.corner[i].z << "\n";
    out << "*ELEMENT, TYPE=C3D8, ELSET=EPLATE\n" << e + 1;
    for (int i = 0; i < 8; ++i) out << ", " << n + 1 + i;
    out << "\n*SOLID SECTION, ELSET=EPLATE, MATERIAL=TISSUE\n*NSET, NSET=PAD\n";
    for (int node : mesh.pad_nodes) out << node + 1 << "\n";
    out << "*SURFACE, NAME=SPAD, TYPE=NODE\nPAD\n*SURFACE, NAME=SPLATE\n"
        << e + 1 << ", S2\n"
        << "*SURFACE INTERACTION, NAME=TOUCH\n*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR\n1e5, 1e-6\n"
        << "*CONTACT PAIR, INTERACTION=TOUCH, TYPE=NODE TO SURFACE\nSPAD, SPLATE\n";
}

/// The mesh with bone nodes held, under nodal loads or pressed by a plate. Lengths in mm, forces in N, stresses in MPa.
void write_job(const std::filesystem::path& path, const TetMesh& mesh, Material material, bool large_strain,
               const std::vector<Vec3<double>>& load, const Plate* plate) {
    const double mu = young / (2 * (1 + poisson)), kappa = young / (3 * (1 - 2 * poisson));
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
    out << "*MATERIAL, NAME=TISSUE\n";
    if (material == Material::neo_hookean)
        out << "*HYPERELASTIC, NEO HOOKE\n" << 1e-6 * mu / 2 << ", " << 1e6 * 2 / kappa << "\n";
    else
        out << "*ELASTIC\n" << 1e-6 * young << ", " << poisson << "\n";
    out << "*SOLID SECTION, ELSET=EALL, MATERIAL=TISSUE\n";
    if (plate) write_plate(out, mesh, *plate);
    out << "*BOUNDARY\n";
    for (int node : mesh.bone_nodes) out << node + 1 << ", 1, 3\n";
    if (large_strain)
        out << "*STEP, NLGEOM, INC=1000\n*CONTROLS, PARAMETERS=FIELD\n1e-9, 1e-7\n*STATIC\n0.1, 1\n";
    else
        out << "*STEP\n*STATIC\n";
    if (plate) {
        out << "*BOUNDARY\n";
        for (int i = 0; i < 8; ++i)
            for (int d = 0; d < 3; ++d)
                out << mesh.nodes.size() + 1 + i << ", " << d + 1 << ", " << d + 1 << ", "
                    << 1e3 * plate->displacement[i][d] << "\n";
    } else {
        out << "*CLOAD\n";
        for (std::size_t i = 0; i < load.size(); ++i)
            for (int d = 0; d < 3; ++d)
                if (load[i][d] != 0) out << i + 1 << ", " << d + 1 << ", " << load[i][d] << "\n";
    }
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

enum class Judge { loads, contact };  ///< CalculiX gets the contact forces, or a plate and finds them itself

void compare(const TetMesh& mesh, Material material, double depth, Judge judge = Judge::loads,
             const Quaternion<double>& turn = Quaternion<double>::identity()) {
    const NodalResult ours = press(mesh, material, depth, turn);
    const Plate plate = plate_under(mesh, ours.plane);
    const bool contact = judge == Judge::contact;
    testing::ScratchFolder scratch;
    write_job(scratch.path / "job.inp", mesh, material, material != Material::corotational, ours.load,
              contact ? &plate : nullptr);
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
    Vec3<double> total{0, 0, 0}, total_error{0, 0, 0};
    for (int i : mesh.bone_nodes) {
        const Vec3<double> reaction = contact ? f[i] : f[i] - ours.load[i];
        largest_f = std::max(largest_f, norm(f[i]));
        error_f = std::max(error_f, norm(ours.reaction[i] - reaction));
        total += reaction;
        total_error += ours.reaction[i] - reaction;
    }
    EXPECT_GT(largest_u, 1e-7);
    EXPECT_LT(error_u, 1e-5 * largest_u);
    EXPECT_LT(error_f, 1e-4 * largest_f);
    EXPECT_LT(norm(total_error), 1e-4 * norm(total));
    std::printf("displacements agree to %.1e, reactions to %.1e of the largest, their sum to %.1e\n",
                error_u / largest_u, error_f / largest_f, norm(total_error) / norm(total));
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
        compare(mesh, Material::corotational, small, Judge::loads, turn);
}

constexpr Material large_strain_materials[] = {Material::saint_venant_kirchhoff, Material::neo_hookean};

TEST(CalculiX, AgreesAtLargeStrain) {
    if (!calculix_is_installed()) GTEST_SKIP() << "CalculiX is not installed (Debian package calculix-ccx)";
    for (Material material : large_strain_materials) {
        compare(testing::block_mesh(4, 3, 3, 0.004), material, 1e-3);
        compare(built_in_finger(347), material, 1e-3);
        compare(built_in_finger(1500), material, 0.7e-3);
    }
}

TEST(CalculiX, FindsTheSameContactWithAPlate) {
    if (!calculix_is_installed()) GTEST_SKIP() << "CalculiX is not installed (Debian package calculix-ccx)";
    for (Material material : large_strain_materials) {
        compare(testing::block_mesh(4, 3, 3, 0.004), material, 1e-3, Judge::contact);
        compare(built_in_finger(347), material, 1e-3, Judge::contact);
        compare(built_in_finger(1500), material, 0.7e-3, Judge::contact);
    }
}

TEST(CalculiX, AgreesOnAGivenMesh) {
    const char* file = std::getenv("PALPATE_JUDGE_MESH");
    if (!file) GTEST_SKIP() << "no mesh given: sh tests/judge.sh FILE";
    if (!calculix_is_installed()) GTEST_SKIP() << "CalculiX is not installed (Debian package calculix-ccx)";
    const char* unit = std::getenv("PALPATE_JUDGE_UNIT");
    FingerTemplates templates;
    std::string note;
    FingerMeshRequest request;
    request.source = FingerMeshRequest::Source::tets;
    request.file = file;
    request.unit = unit ? unit : "mm";
    const TetMesh mesh = make_finger_mesh(request, templates, note);
    std::printf("%s\n", note.c_str());
    double lowest = 0, highest = 0;
    for (const Point& p : mesh.nodes) lowest = std::min(lowest, p[2]), highest = std::max(highest, p[2]);
    const double height = highest - lowest;
    compare(mesh, Material::corotational, 1e-6 * height);
    for (Material material : large_strain_materials)
        for (Judge judge : {Judge::loads, Judge::contact}) compare(mesh, material, 0.04 * height, judge);
}

}  // namespace
}  // namespace palpate
