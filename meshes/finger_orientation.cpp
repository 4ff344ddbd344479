#include "meshes/finger_orientation.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <sstream>

#include "meshes/input_error.h"
#include "meshes/plain_numbers.h"

namespace palpate {

using Eigen::Matrix3d;
using Eigen::Vector3d;

namespace {

/// A triangle as seen along some axes.
struct Patch {
    Vector3d middle, normal;
    double area;
};

Vector3d vector_of(const Point& p) { return {p[0], p[1], p[2]}; }
Point point_of(const Vector3d& v) { return {v[0], v[1], v[2]}; }

/// All triangles, moved to `centre` and turned: rows are the new axes.
std::vector<Patch> patches_of(const Surface& s, const Matrix3d& rows, const Vector3d& centre) {
    std::vector<Patch> out;
    for (const auto& t : s.triangles) {
        const Vector3d a = vector_of(s.vertices[t[0]]), b = vector_of(s.vertices[t[1]]),
                       c = vector_of(s.vertices[t[2]]);
        const Vector3d n = rows * (b - a).cross(c - a);
        const double twice = n.norm();
        if (twice > 0) out.push_back({rows * ((a + b + c) / 3 - centre), n / twice, 0.5 * twice});
    }
    return out;
}

/// Area-weighted principal axes of the surface, longest first, as rows of a rotation; `spread`: deviations along them.
Matrix3d principal_axes(const Surface& s, Vector3d& centre, Vector3d& spread) {
    centre.setZero();
    double area = 0;
    const auto patches = patches_of(s, Matrix3d::Identity(), Vector3d::Zero());
    for (const Patch& p : patches) centre += p.area * p.middle, area += p.area;
    centre /= area;
    Matrix3d covariance = Matrix3d::Zero();
    for (const Patch& p : patches) covariance += p.area / area * (p.middle - centre) * (p.middle - centre).transpose();
    const Eigen::SelfAdjointEigenSolver<Matrix3d> solver(covariance);
    Matrix3d rows;
    for (int k = 0; k < 3; ++k) {
        rows.row(k) = solver.eigenvectors().col(2 - k).transpose();
        spread[k] = std::sqrt(std::max(0.0, solver.eigenvalues()[2 - k]));
    }
    if (rows.determinant() < 0) rows.row(2) *= -1;
    return rows;
}

double clip(double x, double most = 1) { return std::clamp(x, -most, most); }

struct Bounds {
    double low = 1e300, high = -1e300;
    void add(double x) { low = std::min(low, x), high = std::max(high, x); }
    double size() const { return std::max(high - low, 1e-12); }
    double middle() const { return 0.5 * (low + high); }
};

Bounds bounds_along(const std::vector<Patch>& patches, int axis) {
    Bounds b;
    for (const Patch& p : patches) b.add(p.middle[axis]);
    return b;
}

/// From -1 to 1: how much speaks for the tip being at the end of +x. An end that was cut is flat, and as wide as the
/// finger; a tip is round.
double tip_vote(const std::vector<Patch>& patches) {
    const Bounds x = bounds_along(patches, 0);
    double flat[2] = {0, 0}, wide[2] = {0, 0}, area = 0;
    for (const Patch& p : patches) {
        area += p.area;
        const bool front = p.middle[0] > x.middle();
        const double from_end = (front ? x.high - p.middle[0] : p.middle[0] - x.low) / x.size();
        if (from_end < 0.25 && (front ? 1 : -1) * p.normal[0] > 0.94) flat[front] += p.area;
        if (from_end < 0.12) wide[front] = std::max(wide[front], std::hypot(p.middle[1], p.middle[2]));
    }
    const double by_flatness = (flat[0] - flat[1]) / (flat[0] + flat[1] + 0.01 * area);
    const double by_width = 3 * (wide[0] - wide[1]) / std::max(wide[0] + wide[1], 1e-12);
    return clip(0.6 * by_flatness + 0.4 * clip(by_width));
}

/// How much speaks for the nail facing +z, where the tip is at +x: about 1 of the built-in finger, -1 of one that lies
/// on its back, 0 of one on its side.
double nail_vote(const std::vector<Patch>& patches) {
    const Bounds x = bounds_along(patches, 0), z = bounds_along(patches, 2);
    double all = 0, fore = 0, tip = 0, middle = 0;  // areas
    double tip_height = 0, height = 0, closing = 0, flat = 0, tail = 0;
    for (const Patch& p : patches) {
        const double along = (p.middle[0] - x.low) / x.size();
        if (along < 0.25 && p.normal[0] < -0.8) continue;  // the cut says nothing
        all += p.area;
        tail -= p.area * std::pow(2 * p.middle[2] / z.size(), 3);
        if (along > 0.9) tip += p.area, tip_height += p.area * p.middle[2];
        if (along > 0.25 && along < 0.75) middle += p.area, height += p.area * p.middle[2];
        if (along < 0.35) continue;
        fore += p.area;
        closing -= p.area * p.normal[0] * p.normal[2];
        if (std::abs(p.normal[2]) > 0.9) flat += p.area * (p.normal[2] > 0 ? 1 : -1);
    }
    if (tip <= 0 || middle <= 0 || fore <= 0) return 0;
    const double rise = (tip_height / tip - height / middle) / z.size();
    // What each of them is on the built-in fingers.
    return 0.25 * (clip(rise / 0.07, 1.5) + clip(closing / fore / 0.02, 1.5) + clip(tail / all / 0.027, 1.5) +
                   clip(flat / fore / 0.09, 1.5));
}

/// A surface seen with the nail along one of the four directions across its long axis.
struct Candidate {
    Matrix3d rows;
    double vote;
};

}  // namespace

OrientationGuess guess_orientation(const Surface& s) {
    Vector3d centre, spread;
    Matrix3d rows = principal_axes(s, centre, spread);
    const double ends = tip_vote(patches_of(s, rows, centre));
    if (ends < 0) rows.row(0) *= -1, rows.row(1) *= -1;
    std::vector<Candidate> candidates;
    for (int quarter = 0; quarter < 4; ++quarter) {
        // Fingers are wider than they are thick.
        const double wider = std::log(spread[1] / std::max(spread[2], 1e-12)) * (quarter % 2 == 0 ? 1 : -1);
        candidates.push_back({rows, nail_vote(patches_of(s, rows, centre)) + clip(2 * wider, 0.5)});
        const Vector3d y = rows.row(1).transpose();
        rows.row(1) = -rows.row(2);
        rows.row(2) = y.transpose();
    }
    std::sort(candidates.begin(), candidates.end(), [](const auto& a, const auto& b) { return a.vote > b.vote; });
    const double nail = clip(0.8 * (candidates[0].vote - candidates[1].vote));
    const double axis = clip(3 * (spread[0] / std::max(spread[1], 1e-12) - 1));
    OrientationGuess guess;
    guess.orientation = {point_of(candidates[0].rows.row(0).transpose()),
                         point_of(candidates[0].rows.row(2).transpose())};
    guess.confidence = std::min({nail, std::abs(ends), axis});
    guess.doubt = guess.confidence == nail   ? "which way the nail faces"
                  : guess.confidence == axis ? "which axis is the long one"
                                             : "which end is the tip";
    return guess;
}

Surface turn_to_finger_frame(const Surface& s, const FingerOrientation& o) {
    const Vector3d tip = vector_of(o.tip), dorsal = vector_of(o.dorsal);
    const Vector3d across = dorsal.cross(tip);
    if (!(across.norm() > 1e-3 * tip.norm() * dorsal.norm()))
        throw InputError("orientation: tip and dorsal must be two directions of the file's axes that are not parallel");
    Matrix3d rows;
    rows.row(0) = tip.normalized().transpose();
    rows.row(1) = across.normalized().transpose();
    rows.row(2) = rows.row(0).cross(rows.row(1));
    Surface out = s;
    for (Point& p : out.vertices) p = point_of(rows * vector_of(p));
    const auto box = bounds(out.vertices);
    for (Point& p : out.vertices)
        for (int d = 0; d < 3; ++d) p[d] -= 0.5 * (box[0][d] + box[1][d]);
    return out;
}

std::string describe(const OrientationGuess& g) {
    char text[300];
    const auto &t = g.orientation.tip, &d = g.orientation.dorsal;
    plain_snprintf(
        text, sizeof text,
        "guessed: distal = (%.2f, %.2f, %.2f), dorsal = (%.2f, %.2f, %.2f) of the file's axes, confidence %.2f "
        "(least sure: %s)",
        t[0], t[1], t[2], d[0], d[1], d[2], g.confidence, g.doubt.c_str());
    return text;
}

namespace {

/// One view of a surface in the finger frame, far triangles first; `right` and `up` are its axes.
void draw_view(std::ostream& out, const Surface& s, int right, int up, double mirror, double left, double scale) {
    const auto patches = patches_of(s, Matrix3d::Identity(), Vector3d::Zero());
    const int depth = 3 - right - up;
    std::vector<std::size_t> order(s.triangles.size());
    for (std::size_t i = 0; i < order.size(); ++i) order[i] = i;
    auto far = [&](std::size_t i) {
        double sum = 0;
        for (int v : s.triangles[i]) sum += s.vertices[std::size_t(v)][std::size_t(depth)];
        return mirror * sum;
    };
    std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return far(a) < far(b); });
    auto x_of = [&](const Point& p) { return left + 170 + scale * p[std::size_t(right)]; };
    auto y_of = [&](const Point& p) { return 190 - scale * p[std::size_t(up)]; };
    for (std::size_t i : order) {
        const auto& t = s.triangles[i];
        const Vector3d a = vector_of(s.vertices[t[0]]),
                       n = (vector_of(s.vertices[t[1]]) - a).cross(vector_of(s.vertices[t[2]]) - a).normalized();
        if (!(mirror * n[depth] > 0)) continue;
        const int light = int(110 + 120 * std::abs(n[depth]));
        const bool pad = n[2] < -0.3;  // the pad's side is orange, the rest grey
        out << "<polygon points=\"";
        for (int v : t) out << x_of(s.vertices[std::size_t(v)]) << ',' << y_of(s.vertices[std::size_t(v)]) << ' ';
        out << "\" fill=\"rgb(" << light << ',' << (pad ? 2 * light / 3 : light) << ',' << (pad ? light / 3 : light)
            << ")\" stroke=\"none\"/>\n";
    }
    const char* colours[3] = {"#d02020", "#20a020", "#2040d0"};
    const char* names[3] = {"tip (x)", "across (y)", "nail (z)"};
    for (int axis : {right, up}) {
        Point end{0, 0, 0};
        end[std::size_t(axis)] = 140 / scale;
        out << "<line x1=\"" << x_of({0, 0, 0}) << "\" y1=\"" << y_of({0, 0, 0}) << "\" x2=\"" << x_of(end)
            << "\" y2=\"" << y_of(end) << "\" stroke=\"" << colours[axis] << "\" stroke-width=\"3\"/>\n<text x=\""
            << x_of(end) - 20 << "\" y=\"" << y_of(end) - 6 << "\" fill=\"" << colours[axis] << "\">" << names[axis]
            << "</text>\n";
    }
}

}  // namespace

std::string orientation_picture(const Surface& surface, const FingerOrientation& orientation,
                                const std::string& title) {
    const Surface s = turn_to_finger_frame(surface, orientation);
    double size = 1e-9;
    for (const Point& p : s.vertices)
        for (double x : p) size = std::max(size, std::abs(x));
    std::string text;
    for (char c : title) text += c == '<' ? "&lt;" : c == '&' ? "&amp;" : std::string(1, c);
    PlainText out;
    out.precision(5);
    out << "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"720\" height=\"400\" font-family=\"sans-serif\" "
           "font-size=\"12\">\n<rect width=\"720\" height=\"400\" fill=\"white\"/>\n<text x=\"10\" y=\"20\" "
           "font-size=\"9\">"
        << text << "</text>\n<text x=\"10\" y=\"390\">from the side</text>\n<text x=\"370\" y=\"390\">from above (the "
        << "nail)</text>\n";
    draw_view(out, s, 0, 2, -1, 0, 120 / size);
    draw_view(out, s, 0, 1, 1, 360, 120 / size);
    out << "</svg>\n";
    return out.str();
}

}  // namespace palpate
