#include "tests/support.h"

#include <sys/wait.h>

#include <cstdio>

#include <unistd.h>

#include <Eigen/Dense>

#include "meshes/mesh_quality.h"

namespace palpate::testing {

TetMesh block_mesh(int nx, int ny, int nz, double h) {
    TetMesh m;
    auto id = [&](int i, int j, int k) { return (i * (ny + 1) + j) * (nz + 1) + k; };
    for (int i = 0; i <= nx; ++i)
        for (int j = 0; j <= ny; ++j)
            for (int k = 0; k <= nz; ++k)
                m.nodes.push_back({(i - 0.5 * nx) * h, (j - 0.5 * ny) * h, (k - 0.5 * nz) * h});
    const int paths[6][2] = {{1, 2}, {2, 1}, {1, 4}, {4, 1}, {2, 4}, {4, 2}};  // Kuhn's six
    for (int i = 0; i < nx; ++i)
        for (int j = 0; j < ny; ++j)
            for (int k = 0; k < nz; ++k) {
                int v[8];
                for (int b = 0; b < 8; ++b) v[b] = id(i + (b & 1), j + ((b >> 1) & 1), k + ((b >> 2) & 1));
                for (const auto& p : paths) {
                    std::array<int, 4> t{v[0], v[p[0]], v[p[0] | p[1]], v[7]};
                    Eigen::Matrix3d D;
                    for (int a = 1; a < 4; ++a)
                        for (int d = 0; d < 3; ++d) D(d, a - 1) = m.nodes[t[a]][d] - m.nodes[t[0]][d];
                    if (D.determinant() < 0) std::swap(t[1], t[2]);
                    m.tets.push_back(t);
                }
            }
    for (int i = 0; i <= nx; ++i)
        for (int j = 0; j <= ny; ++j) {
            m.bone_nodes.push_back(id(i, j, nz));
            m.pad_nodes.push_back(id(i, j, 0));
        }
    m.surface = boundary(m.tets);
    return m;
}

template <class T>
SkinChunk<T> make_chunk(const TetMesh& mesh, const Pose<double>& bone, const ChunkOptions& o) {
    SkinChunk<T> chunk;
    allocate_chunk(chunk, std::make_shared<SkinTopology>(build_topology(mesh, o.width > 1, o.sample_refinement)),
                   o.width, o.limits, o.friction, o.objects);
    SkinParameters p;
    p.mesh = &mesh;
    p.young_modulus = {o.young};
    p.poisson_ratio = o.poisson;
    p.has_limits = o.limits;
    p.limit_low = {o.low};
    p.limit_high = {o.high};
    for (int lane = 0; lane < o.width; ++lane) set_lane(chunk, lane, lane, p, bone);
    aim_all(chunk, 2000, 2, bone);
    return chunk;
}
template SkinChunk<double> make_chunk(const TetMesh&, const Pose<double>&, const ChunkOptions&);
template SkinChunk<float> make_chunk(const TetMesh&, const Pose<double>&, const ChunkOptions&);

template <class T>
void aim_all(SkinChunk<T>& c, double linear, double angular, const Pose<double>& target) {
    const double v[9] = {linear,
                         angular,
                         target.position.x,
                         target.position.y,
                         target.position.z,
                         target.rotation.w,
                         target.rotation.x,
                         target.rotation.y,
                         target.rotation.z};
    for (int s = 0; s < bone_spring_count; ++s)
        for (int i = 0; i < 9; ++i)
            for (int l = 0; l < c.width; ++l) {
                const double origin = i >= 2 && i < 5 ? c.state.origin[(i - 2) * c.width + l] : 0;
                c.scratch.bone_springs[(9 * s + i) * c.width + l] = T(s > 0 && i < 2 ? 0 : v[i] - origin);
            }
    std::fill(c.scratch.coupling_reach.begin(), c.scratch.coupling_reach.end(), T(1e30));
}
template void aim_all(SkinChunk<double>&, double, double, const Pose<double>&);
template void aim_all(SkinChunk<float>&, double, double, const Pose<double>&);

double central_difference(const std::function<double(const std::vector<double>&)>& f, std::vector<double> x,
                          std::size_t i, double h) {
    const double x0 = x[i];
    x[i] = x0 + h;
    const double high = f(x);
    x[i] = x0 - h;
    return (high - f(x)) / (2 * h);
}

Modes symmetric_modes(const Eigen::MatrixXd& matrix) {
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(matrix);
    return {solver.eigenvalues(), solver.eigenvectors()};
}

std::filesystem::path shared_data() {
    std::error_code error;
    for (const char* folder : {PALPATE_SOURCE_DIR "/../shared/data", PALPATE_SOURCE_DIR "/shared/data"})
        if (std::filesystem::is_directory(folder, error)) return folder;
    return {};
}

namespace {
std::filesystem::path make_scratch() {
    std::string name = (std::filesystem::temp_directory_path() / "palpate-test-XXXXXX").string();
    if (!mkdtemp(name.data())) throw std::runtime_error("no scratch folder");
    return name;
}
}  // namespace

ScratchFolder::ScratchFolder() : path(make_scratch()) {}
ScratchFolder::~ScratchFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path, ignored);
}

Outcome shell(const std::string& command) {
    Outcome o;
    FILE* pipe = popen((command + " 2>&1").c_str(), "r");
    char text[4096];
    for (std::size_t n; (n = std::fread(text, 1, sizeof text, pipe)) > 0;) o.out.append(text, n);
    const int status = pclose(pipe);
    o.code = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
    return o;
}

std::string source_dir() { return PALPATE_SOURCE_DIR; }

std::string program_path() {
    const char* other = std::getenv("PALPATE_PROGRAM");
    return other ? other : PALPATE_PROGRAM;
}

Outcome palpate_program(const std::string& arguments) { return shell(program_path() + " " + arguments); }

}  // namespace palpate::testing
