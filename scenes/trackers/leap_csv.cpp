#include "scenes/trackers/leap_csv.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <fstream>
#include <map>
#include <optional>

#include "meshes/byte_order_mark.h"
#include "meshes/input_error.h"
#include "meshes/plain_numbers.h"

namespace palpate {

namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr std::array<const char*, 5> leap_names{"thumb", "index", "middle", "ring", "pinky"};
/// By how much a right hand's distal bones are turned about themselves against the palm, where a finger is too straight
/// to show it [rad]: as measured in a recorded hand that has bases.
constexpr std::array<double, 5> usual_twist{-1.38, -0.06, 0.19, 0.26, 0.49};

/// Cells of a row, the last one too where it is empty.
std::vector<std::string> split(std::string line) {
    if (!line.empty() && line.back() == '\r') line.pop_back();
    std::vector<std::string> cells{""};
    for (char c : line)
        if (c == ',')
            cells.emplace_back();
        else
            cells.back() += c;
    return cells;
}

using Vector3Columns = std::array<int, 3>;

/// Where things stand in a row; what a file does not have is absent.
struct LeapColumns {
    struct Finger {
        Vector3Columns joint, tip;
        std::optional<Vector3Columns> mcp, pip;
        std::optional<std::array<Vector3Columns, 3>> basis;
    };
    int time, hand;
    std::array<Finger, 5> fingers;
    std::optional<Vector3Columns> palm, palm_normal, direction;
};

struct LeapHeader {
    std::filesystem::path path;
    std::map<std::string, int> column;
    int need(const std::string& name) const {
        const auto it = column.find(name);
        if (it == column.end()) refuse_line(path, 1, "column '" + name + "' is missing");
        return it->second;
    }
    std::optional<Vector3Columns> find(const std::string& name, const std::array<const char*, 3>& suffix) const {
        Vector3Columns out;
        for (std::size_t d = 0; d < 3; ++d) {
            const auto it = column.find(name + suffix[d]);
            if (it == column.end()) return {};
            out[d] = it->second;
        }
        return out;
    }
    Vector3Columns need_vector(const std::string& name) const {
        return {need(name + "_x"), need(name + "_y"), need(name + "_z")};
    }
};

LeapColumns find_columns(const LeapHeader& head) {
    const std::array<const char*, 3> xyz{"_x", "_y", "_z"};
    LeapColumns c{head.need("t_us"),      head.need("hand"),       {},
                  head.find("palm", xyz), head.find("palmN", xyz), head.find("dir", xyz)};
    for (std::size_t f = 0; f < 5; ++f) {
        const std::string name = leap_names[f];
        LeapColumns::Finger& finger = c.fingers[f];
        finger = {head.need_vector(name + "_dip"),
                  head.need_vector(name + "_tip"),
                  head.find(name + "_mcp", xyz),
                  head.find(name + "_pip", xyz),
                  {}};
        std::array<Vector3Columns, 3> basis;
        bool whole = true;
        for (std::size_t d = 0; d < 3 && whole; ++d) {
            const auto axis = head.find(name + "_distalbasis_" + std::to_string(d), {"0", "1", "2"});
            whole = axis.has_value();
            if (whole) basis[d] = *axis;
        }
        if (whole) finger.basis = basis;
    }
    for (std::size_t f = 0; f < 5; ++f) {
        const LeapColumns::Finger& finger = c.fingers[f];
        const std::string name = leap_names[f];
        if (finger.basis) continue;
        if (!finger.mcp || !finger.pip)
            refuse_line(head.path, 1,
                        "columns '" + name + "_distalbasis_00' to '_22' are missing, and without them '" + name +
                            "_mcp' and '" + name + "_pip' (_x, _y, _z), from which they would follow");
        if (!(c.palm_normal && c.direction) && !(c.palm && c.fingers[1].mcp && c.fingers[4].mcp))
            refuse_line(head.path, 1,
                        "bones without bases need the palm: columns 'palmN' and 'dir', or 'palm', 'index_mcp' and "
                        "'pinky_mcp' (_x, _y, _z)");
    }
    return c;
}

/// The cells of one row as numbers.
struct LeapRow {
    const std::filesystem::path& path;
    int number;
    std::vector<std::string> cells;
    double value(int c) const {
        const std::string& cell = cells[std::size_t(c)];
        char* end = nullptr;
        const double x = plain_strtod(cell.c_str(), &end);
        if (cell.empty() || *end || !std::isfinite(x))
            refuse_line(path, number, "expected a number in cell " + std::to_string(c + 1) + ", found '" + cell + "'");
        return x;
    }
    Vector3d vector(const Vector3Columns& c) const { return {value(c[0]), value(c[1]), value(c[2])}; }
};

struct Palm {
    Vector3d distal, dorsal;
};

Palm palm_of(const LeapColumns& c, const LeapRow& row, bool right) {
    if (c.palm_normal && c.direction) return {row.vector(*c.direction), -row.vector(*c.palm_normal)};
    const Vector3d index = row.vector(*c.fingers[1].mcp), little = row.vector(*c.fingers[4].mcp);
    const Vector3d distal = 0.5 * (index + little) - row.vector(*c.palm);
    return {distal, (right ? -1 : 1) * distal.cross(little - index)};
}

/// Axes of a distal bone (columns: x sideways, y dorsal, z proximal) from the joints of its finger. A finger bends in
/// one plane, which holds the bone's dorsal axis; `twist` remembers how that is turned against the palm, for when the
/// finger is straight.
Matrix3d basis_from_joints(const std::array<Vector3d, 4>& joints, const Palm& palm, double& twist) {
    const Vector3d distal = (joints[3] - joints[2]).normalized();
    const Vector3d level = palm.distal.cross(palm.dorsal).normalized().cross(distal).normalized();
    const Vector3d usual = Eigen::AngleAxisd(twist, distal) * level;
    const Vector3d second = (joints[2] - joints[1]).normalized(), first = (joints[1] - joints[0]).normalized();
    const Vector3d hinge = distal.cross(second) + second.cross(first);
    Vector3d dorsal = usual;
    if (hinge.norm() > 0.1) {  // bent by 6 degrees in all
        dorsal = hinge.cross(distal).normalized();
        if (dorsal.dot(usual) < 0) dorsal = -dorsal;
        const double seen = std::atan2(level.cross(dorsal).dot(distal), level.dot(dorsal));
        if (std::isfinite(seen)) twist = seen;
    }
    Matrix3d basis;
    basis << dorsal.cross(-distal), dorsal, -distal;
    return basis;
}

}  // namespace

HandRecording read_leap_csv(const std::filesystem::path& path, const std::string& hand) {
    std::ifstream in(path);
    skip_byte_order_mark(in);
    std::string line;
    if (!std::getline(in, line)) refuse_line(path, 1, "the file is empty");
    LeapHeader head{path, {}};
    const auto names = split(line);
    for (std::size_t i = 0; i < names.size(); ++i)
        if (!head.column.try_emplace(names[i], int(i)).second)
            refuse_line(path, 1, "two columns are called '" + names[i] + "'");
    const LeapColumns c = find_columns(head);
    const bool right = hand == "right";
    std::array<double, 5> twist = usual_twist;
    for (double& t : twist) t *= right ? 1 : -1;
    HandRecording recording;
    double first_time = 0;
    bool started = false;
    for (int number = 2; std::getline(in, line); ++number) {
        const LeapRow row{path, number, split(line)};
        if (row.cells.size() == 1 && row.cells[0].empty()) continue;
        if (row.cells.size() != names.size())
            refuse_line(path, number,
                        "expected " + std::to_string(names.size()) + " cells, found " +
                            std::to_string(row.cells.size()) + " (truncated?)");
        const double time = 1e-6 * row.value(c.time);
        if (!started) first_time = time, started = true;
        if (row.cells[std::size_t(c.hand)] != hand) continue;
        HandFrame frame;
        frame.valid = true;
        for (std::size_t f = 0; f < 5; ++f) {
            const LeapColumns::Finger& finger = c.fingers[f];
            const Vector3d joint = row.vector(finger.joint), tip = row.vector(finger.tip);
            Matrix3d basis;
            if (finger.basis)
                for (int d = 0; d < 3; ++d) basis.col(d) = row.vector((*finger.basis)[std::size_t(d)]);
            else
                basis = basis_from_joints({row.vector(*finger.mcp), row.vector(*finger.pip), joint, tip},
                                          palm_of(c, row, right), twist[f]);
            if (!basis.allFinite() || (tip - joint).norm() == 0) {
                frame.valid = false;  // joints that coincide say nothing
                continue;
            }
            set_finger(frame, int(f), joint, tip, basis, {1e-3, true});
        }
        add_frame(recording, frame, time - first_time, path, number);
    }
    if (!c.fingers[0].basis || !c.fingers[1].basis)
        recording.note = "it has no bases of bones: which way nails face follows from the joints";
    return recording;
}

}  // namespace palpate
