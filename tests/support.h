#pragma once
// What several tests share: small meshes, chunks, finite differences.

#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <functional>
#include <random>
#include <thread>
#include <vector>

#include "engine/build.h"
#include "engine/skin/chunks/chunk.h"
#include "engine/skin/solve/solve_skin.h"

namespace palpate::testing {

/// Whether the case of this number is tried: of a test's many cases every `of`-th is in each run, all with
/// PALPATE_ALL_CASES, as the nightly preset has it.
inline bool is_tried(int number, int of) { return std::getenv("PALPATE_ALL_CASES") || number % of == 0; }

/// A block of nx x ny x nz cubes of edge h, six tetrahedra each, centred at the origin. The top layer of
/// nodes belongs to the bone, the bottom layer is the pad.
TetMesh block_mesh(int nx, int ny, int nz, double h);

/// A chunk of `width` fingers of one mesh, at rest with the bone at `bone`.
struct ChunkOptions {
    int width = 1;
    bool limits = true;
    double low = 0.7, high = 1.3;
    bool friction = false;
    int objects = 1;
    int sample_refinement = 1;
    double young = 30e3, poisson = 0.45;
};
template <class T>
SkinChunk<T> make_chunk(const TetMesh& mesh, const Pose<double>& bone, const ChunkOptions& options);

/// Aims all lanes' couplings: stiffness [N/m], angular stiffness [N m/rad]; no damper, no bone inertia.
template <class T>
void aim_all(SkinChunk<T>& chunk, double linear, double angular, const Pose<double>& target);

/// The one object that all lanes touch.
template <class T>
LaneContact& touch_all(SkinChunk<T>& chunk, const LaneContact& object) {
    for (int lane = 0; lane < chunk.width; ++lane) {
        if (chunk.contacts.count[std::size_t(lane)] > 0) erase_contact(chunk, lane, 0);
        insert_contact(chunk, lane, 0, object);
    }
    return chunk.contacts.at(0, 0);
}

/// Central difference of f along component i of x.
double central_difference(const std::function<double(const std::vector<double>&)>& f, std::vector<double> x,
                          std::size_t i, double h);

/// Eigenvalues, in ascending order, and eigenvectors (columns) of a symmetric matrix. (A function: Eigen's solver takes
/// seven seconds to compile in each source that has one.)
struct Modes {
    Eigen::VectorXd values;
    Eigen::MatrixXd vectors;
};
Modes symmetric_modes(const Eigen::MatrixXd& matrix);

/// Whether a condition comes true within fifteen seconds.
template <class Condition>
bool eventually(Condition condition) {
    for (int k = 0; k < 7500; ++k) {
        if (condition()) return true;
        std::this_thread::sleep_for(std::chrono::milliseconds(2));
    }
    return false;
}

/// Root of the checkout, and the program that was built from it. (Functions, so that no object depends on where the
/// checkout lies.)
std::string source_dir();
inline const std::string scenes = source_dir() + "/scenes/";
std::string program_path();  ///< or what the environment names: PALPATE_PROGRAM, a build with sanitizers

/// Folder of real inputs, beside the checkout; empty where it is absent.
std::filesystem::path shared_data();

/// What a command said (standard output and errors) and how it ended.
struct Outcome {
    int code = 0;
    std::string out;
};
Outcome shell(const std::string& command);
/// The program with these arguments.
Outcome palpate_program(const std::string& arguments);

/// A scratch folder that is removed at the end of the test.
class ScratchFolder {
  public:
    ScratchFolder();
    ~ScratchFolder();
    const std::filesystem::path path;
};

/// Relative distance of two numbers with an absolute floor.
inline double relative_error(double a, double b, double floor) {
    return std::abs(a - b) / std::max({std::abs(a), std::abs(b), floor});
}

#define PALPATE_NEED_SHARED_DATA(folder)                                  \
    const std::filesystem::path folder = palpate::testing::shared_data(); \
    if (folder.empty()) GTEST_SKIP() << "real inputs (shared/data) are not beside this checkout"

}  // namespace palpate::testing
