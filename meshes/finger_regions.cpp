#include "meshes/finger_regions.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <set>

#include "meshes/input_error.h"

namespace palpate {

using Eigen::Matrix3d;
using Eigen::Vector3d;

void mark_pad(TetMesh& mesh) {
    const std::set<int> bone(mesh.bone_nodes.begin(), mesh.bone_nodes.end());
    std::set<int> pad;
    for (const auto& t : mesh.surface)
        for (int i : t)
            if (!bone.count(i)) pad.insert(i);
    mesh.pad_nodes.assign(pad.begin(), pad.end());
    if (mesh.bone_nodes.size() < 3)
        throw InputError("fewer than three bone nodes: the finger would not follow the hand; widen the bone region");
    if (mesh.pad_nodes.empty())
        throw InputError("no pad node is left: all surface nodes belong to the bone; narrow the bone region");
}

void mark_regions(TetMesh& mesh, const FingerRegions& r) {
    const auto box = bounds(mesh.nodes);
    const double length = box[1][0] - box[0][0], thickness = box[1][2] - box[0][2];
    mesh.bone_nodes.clear();
    for (int i = 0; i < int(mesh.nodes.size()); ++i) {
        const Point& p = mesh.nodes[i];
        const double along = p[0] - box[0][0], height = p[2] - box[0][2];
        const double beyond = std::max(0.0, along - r.phalanx_length * length + r.phalanx_radius * thickness);
        const double from_axis =
            std::hypot(beyond, p[1] - 0.5 * (box[0][1] + box[1][1]), height - r.phalanx_height * thickness);
        if (along < r.cut * length || height > r.nail * thickness || from_axis < r.phalanx_radius * thickness)
            mesh.bone_nodes.push_back(i);
    }
    mark_pad(mesh);
}

void mark_half_space(TetMesh& mesh, const Point& n, double offset) {
    mesh.bone_nodes.clear();
    for (int i = 0; i < int(mesh.nodes.size()); ++i) {
        const Point& p = mesh.nodes[i];
        if (n[0] * p[0] + n[1] * p[1] + n[2] * p[2] > offset) mesh.bone_nodes.push_back(i);
    }
    mark_pad(mesh);
}

namespace {

Surface transformed(const Surface& s, const Matrix3d& rows, const Vector3d& centre) {
    Surface out = s;
    for (std::size_t i = 0; i < s.vertices.size(); ++i) {
        const Vector3d p = rows * (Eigen::Map<const Vector3d>(s.vertices[i].data()) - centre);
        out.vertices[i] = {p[0], p[1], p[2]};
    }
    return out;
}

/// Area-weighted principal axes of the surface, longest first, as rows of a rotation.
Matrix3d principal_axes(const Surface& s, Vector3d& centre) {
    centre.setZero();
    double area = 0;
    auto corner = [&](int i) { return Vector3d(Eigen::Map<const Vector3d>(s.vertices[i].data())); };
    auto for_each = [&](auto visit) {
        for (const auto& t : s.triangles) {
            const Vector3d a = corner(t[0]), b = corner(t[1]), c = corner(t[2]);
            visit((a + b + c) / 3, 0.5 * (b - a).cross(c - a).norm());
        }
    };
    for_each([&](const Vector3d& p, double w) { centre += w * p, area += w; });
    centre /= area;
    Matrix3d covariance = Matrix3d::Zero();
    for_each([&](const Vector3d& p, double w) { covariance += w / area * (p - centre) * (p - centre).transpose(); });
    const Eigen::SelfAdjointEigenSolver<Matrix3d> solver(covariance);
    Matrix3d rows;
    for (int k = 0; k < 3; ++k) rows.row(k) = solver.eigenvectors().col(2 - k).transpose();
    if (rows.determinant() < 0) rows.row(2) *= -1;
    return rows;
}

/// Area of triangles that face within 20 degrees of direction d and lie in the outer tenth that way:
/// large where the segment was cut flat.
double flat_area(const Surface& s, const Vector3d& d) {
    double reach = -1e300, back = 1e300, area = 0;
    for (const Point& p : s.vertices) {
        const double x = d.dot(Eigen::Map<const Vector3d>(p.data()));
        reach = std::max(reach, x);
        back = std::min(back, x);
    }
    for (const auto& t : s.triangles) {
        const Vector3d a = Eigen::Map<const Vector3d>(s.vertices[t[0]].data()),
                       b = Eigen::Map<const Vector3d>(s.vertices[t[1]].data()),
                       c = Eigen::Map<const Vector3d>(s.vertices[t[2]].data());
        const Vector3d n = (b - a).cross(c - a);
        if (n.dot(d) > 0.94 * n.norm() && d.dot(a + b + c) / 3 > reach - 0.25 * (reach - back)) area += 0.5 * n.norm();
    }
    return area;
}

}  // namespace

FrameGuess to_finger_frame(const Surface& s) {
    Vector3d centre;
    Matrix3d rows = principal_axes(s, centre);
    FrameGuess guess;
    const Vector3d axis = rows.row(0).transpose();
    if (flat_area(s, axis) > flat_area(s, -axis)) rows.row(0) *= -1, rows.row(1) *= -1;
    Surface turned = transformed(s, rows, centre);
    // The tip lies dorsal of the middle of the section at half length.
    auto box = bounds(turned.vertices);
    double tip = 0, low = 1e300, high = -1e300;
    for (const Point& p : turned.vertices) {
        if (p[0] == box[1][0]) tip = p[2];
        if (std::abs(p[0] - 0.5 * (box[0][0] + box[1][0])) < 0.25 * (box[1][0] - box[0][0])) {
            low = std::min(low, p[2]);
            high = std::max(high, p[2]);
        }
    }
    if (tip < 0.5 * (low + high)) {
        rows.row(1) *= -1, rows.row(2) *= -1;
        turned = transformed(s, rows, centre);
        box = bounds(turned.vertices);
    }
    const Vector3d middle(0.5 * (box[0][0] + box[1][0]), 0.5 * (box[0][1] + box[1][1]), 0.5 * (box[0][2] + box[1][2]));
    guess.surface = transformed(turned, Matrix3d::Identity(), middle);
    char text[200];
    std::snprintf(text, sizeof text,
                  "guessed: distal = (%.2f, %.2f, %.2f), dorsal = (%.2f, %.2f, %.2f) of the file's axes", rows(0, 0),
                  rows(0, 1), rows(0, 2), rows(2, 0), rows(2, 1), rows(2, 2));
    guess.explanation = text;
    return guess;
}

}  // namespace palpate
