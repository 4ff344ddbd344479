#include "engine/bodies/body_contact.h"

#include <algorithm>
#include <cmath>

#include "engine/bodies/fitted.h"
#include "engine/contact/sides.h"
#include "engine/math/svd3.h"

namespace palpate {

namespace {

/// Heights along an axis, ends included, about a diameter apart, at most 17.
std::vector<double> along_axis(double half_length, double radius, int fewest_gaps) {
    const int gaps = std::clamp(int(std::ceil(half_length / radius)), fewest_gaps, 16);
    std::vector<double> heights;
    for (int i = 0; i <= gaps; ++i) heights.push_back(half_length * (2.0 * i / gaps - 1));
    return heights;
}

/// Mean distance of a rectangle's points from its middle, by its half edges.
double mean_arm(double a, double b) {
    constexpr int parts = 32;
    double sum = 0;
    for (int i = 0; i < parts; ++i)
        for (int j = 0; j < parts; ++j) sum += std::hypot(a * (i + 0.5) / parts, b * (j + 0.5) / parts);
    return sum / (parts * parts);
}

/// A box against planes: its corners, and of each face four points more, so near its middle that rubbing brakes the
/// spin of a box that lies on it as all of the face would.
std::vector<Feature> points_of_box(const Vec3<double>& half) {
    std::vector<Feature> out;
    for (double x : {-half.x, half.x})
        for (double y : {-half.y, half.y})
            for (double z : {-half.z, half.z}) out.push_back({{x, y, z}, 0, {0, 0, 0}, {0, 0, 0}});
    for (int axis = 0; axis < 3; ++axis) {
        const int u = (axis + 1) % 3, v = (axis + 2) % 3;
        const double share = 2 * mean_arm(half[u], half[v]) / std::hypot(half[u], half[v]) - 1;
        for (double side : {-1.0, 1.0})
            for (double i : {-share, share})
                for (double j : {-share, share}) {
                    Vec3<double> point;
                    point[axis] = side * half[axis], point[u] = i * half[u], point[v] = j * half[v];
                    out.push_back({point, 0, {0, 0, 0}, {0, 0, 0}});
                }
    }
    return out;
}

}  // namespace

std::vector<Feature> features_of(const Shape& shape, bool against_planes) {
    const Vec3<double>& s = shape.size;
    std::vector<Feature> out;
    switch (shape.kind) {
        case ShapeKind::plane:
            break;
        case ShapeKind::box: {
            if (against_planes) return points_of_box(s);
            // Corners are round, by a little: where boxes of one size lie flush, sharp corners would sit on edges, from
            // where up is no nearer than out.
            const double r = std::min(fitted::corner_radius, 0.02 * std::min({s.x, s.y, s.z}));
            const Vec3<double> c{s.x - r, s.y - r, s.z - r};
            for (int i = -1; i <= 1; ++i)
                for (int j = -1; j <= 1; ++j)
                    for (int k = -1; k <= 1; ++k)
                        if (i || j || k) {
                            const bool edge = i * i + j * j + k * k == 2;
                            out.push_back({{i * c.x, j * c.y, k * c.z}, r, {0, 0, 0}, {0, 0, 0}});
                            if (edge) out.back().along = {i ? 0 : c.x, j ? 0 : c.y, k ? 0 : c.z};
                        }
            break;
        }
        case ShapeKind::sphere:
            out.push_back({{0, 0, 0}, s.x, {0, 0, 0}, {0, 0, 0}});
            break;
        case ShapeKind::capsule:
            for (double z : along_axis(s.y, s.x, 1)) out.push_back({{0, 0, z}, s.x, {0, 0, 0}, {0, 0, 0}});
            if (!against_planes) out.push_back({{0, 0, 0}, s.x, {0, 0, 0}, {0, 0, s.y}});
            break;
        case ShapeKind::cylinder:
            // A disc in the middle, too: those at the ends of two that stand beside each other are flush with both.
            for (double z : along_axis(s.y, s.x, 2))
                if (std::abs(z) < s.y) out.push_back({{0, 0, z}, s.x, {0, 0, 1}, {0, 0, 0}});
            if (!against_planes) out.push_back({{0, 0, 0}, s.x, {0, 0, 1}, {0, 0, s.y}});
            // Of an end that lies flush no point of the rim is deepest, but the middle is as deep as three more, where
            // rubbing brakes its spin as all of the disc would (3/4 of the load at 8/9 of the radius).
            for (double end : {-s.y, s.y}) {
                const Vec3<double> facing{0, 0, end < 0 ? -1.0 : 1.0};
                out.push_back({{0, 0, end}, s.x, {0, 0, 1}, {0, 0, 0}, facing});
                for (double angle : {0.0, 2.0943951023931953, -2.0943951023931953})
                    out.push_back({{8 * s.x / 9 * std::cos(angle), 8 * s.x / 9 * std::sin(angle), end},
                                   0,
                                   {0, 0, 0},
                                   {0, 0, 0},
                                   facing});
            }
            break;
        case ShapeKind::mesh:
            if (against_planes)
                for (const Vec3<double>& p : shape.mesh->support) out.push_back({p, 0, {0, 0, 0}, {0, 0, 0}});
            else
                for (const DistanceMesh::Ball& b : shape.mesh->balls)
                    out.push_back({b.centre, b.radius, {0, 0, 0}, {0, 0, 0}});
            break;
    }
    return out;
}

Touch touch_of(const Feature& f, const Pose<double>& a, const FeatureContact& c, const Shape& shape,
               const Pose<double>& b, int side) {
    const Vec3<double> middle = transform(a, f.point + c.place * f.along);
    Touch out{middle, surface_at(c, shape, b, middle, side)};
    if (f.radius <= 0) return out;
    const Vec3<double> n = (1 / std::max(norm(out.surface.normal), 1e-6)) * out.surface.normal;
    if (dot(c.rim, c.rim) > 0) {
        out.point = middle + rotation_matrix(a.rotation) * c.rim;
        out.surface = surface_at(c, shape, b, out.point, side);
        return out;
    }
    if (dot(f.axis, f.axis) > 0) {
        const Vec3<double> axis = rotation_matrix(a.rotation) * f.axis, across = n - dot(n, axis) * axis;
        const double tilt = norm(across), least = std::min(tilt, c.blunt);
        out.point = middle - (f.radius / std::max(tilt, c.blunt)) * across;
        out.surface = surface_at(c, shape, b, out.point, side);
        out.surface.distance += f.radius * least * least / (2 * c.blunt);
        return out;
    }
    out.point = middle - f.radius * n;
    out.surface.distance -= f.radius;
    return out;
}

namespace {

/// Where an edge is deepest in b, that was at `place` in the last step: near there, as on what is round, or elsewhere
/// if that is deeper by more than what tells one end of a face that it lies on from the other. Distances of convex
/// objects are convex along it.
double deepest_place(const Feature& f, const FeatureContact& c, const Pose<double>& a, const Shape& shape,
                     const Pose<double>& b) {
    using namespace fitted;
    auto distance = [&](double place) {
        return surface_at(c, shape, b, transform(a, f.point + place * f.along), 0).distance;
    };
    const double here = distance(c.place);
    if (here - f.radius > (1 + std::abs(c.place)) * norm(f.along) + near_gap) return c.place;
    const int gaps = shape.kind == ShapeKind::mesh ? 16 : 4;
    double least = here, most = here, low = c.place, high = c.place;
    for (int i = 0; i <= gaps; ++i) {
        const double place = 2.0 * i / gaps - 1, d = distance(place);
        if (d < least - edge_depth) least = d, low = place - 2.0 / gaps, high = place + 2.0 / gaps;
        most = std::max(most, d);
    }
    if (most - least < edge_depth) return c.place;  // it lies along a face
    if (!(low < high)) low = c.place - 2.0 / gaps, high = c.place + 2.0 / gaps;
    low = std::max(low, -1.0), high = std::min(high, 1.0);
    constexpr double golden = 0.61803398874989485;
    double first = high - golden * (high - low), second = low + golden * (high - low);
    double at_first = distance(first), at_second = distance(second);
    for (int i = 0; i < edge_sections; ++i) {
        if (std::abs(at_first - at_second) < rounded_gap) {  // on a face: within it, and not at its edge
            low = first, high = second;
            first = high - golden * (high - low), second = low + golden * (high - low);
            at_first = distance(first), at_second = distance(second);
        } else if (at_first < at_second) {
            high = second, second = first, at_second = at_first;
            first = high - golden * (high - low), at_first = distance(first);
        } else {
            low = first, first = second, at_first = at_second;
            second = low + golden * (high - low), at_second = distance(second);
        }
    }
    const double found = 0.5 * (low + high);
    const bool is_near = std::abs(found - c.place) * norm(f.along) < edge_follows;
    return is_near || distance(found) < here - edge_depth ? found : c.place;
}

/// Where a mesh's smooth field waves under a disc that is nearly upright on it, the normal at its middle does not tell
/// which point of its rim is deepest, and energies would not be what forces say: that is looked for here, and is one
/// point of the body for all of the step; in the next the same one, unless another is deeper by more than waves are.
void set_rim(const Feature& f, const ContactBody& a, const ContactBody& b, FeatureContact& c) {
    using namespace fitted;
    const Vec3<double> before = c.rim;
    c.rim = {0, 0, 0};
    if (dot(f.axis, f.axis) <= 0 || b.shape->kind != ShapeKind::mesh) return;
    const Mat3<double> R = rotation_matrix(a.pose.rotation);
    const Vec3<double> middle = transform(a.pose, f.point + c.place * f.along);
    auto at = [&](const Vec3<double>& rim) { return surface_point(*b.shape, b.pose, middle + R * rim); };
    const SurfacePoint<double> there = at({0, 0, 0});
    const Vec3<double> axis = R * f.axis;
    const double tilt = norm(there.normal - dot(there.normal, axis) * axis);
    if (tilt > most_blunt || there.distance > f.radius * most_blunt + near_gap) return;
    const Vec3<double> u = detail::any_orthogonal(f.axis), v = cross(f.axis, u);
    double least = HUGE_VAL, waves = 0;
    Vec3<double> deepest{0, 0, 0};
    for (int i = 0; i < rim_samples; ++i) {
        const double angle = 2 * M_PI * i / rim_samples;
        const Vec3<double> rim = f.radius * (std::cos(angle) * u + std::sin(angle) * v);
        const SurfacePoint<double> point = at(rim);
        if (point.distance < least) least = point.distance, deepest = rim;
        if (dot(point.normal, there.normal) > same_face) waves = std::max(waves, norm(point.normal - there.normal));
    }
    if (steady_tilt * waves < std::max(tilt, c.blunt)) return;
    const bool stays = dot(before, before) > 0 && at(before).distance < least + edge_depth + waves * f.radius;
    c.rim = stays ? before : deepest;
}

/// How a turns in b's frame along the way that they would take without each other: the same for all that touches.
struct RelativeTurn {
    Vec3<double> centre, centre_before;  ///< a's, at the end and at the start
    Vec3<double> axis;
    double angle;
};
RelativeTurn relative_turn(const ContactBody& a, const ContactBody& b) {
    const Quaternion<double> turn =
        (conjugate(b.pose.rotation) * a.pose.rotation) * conjugate(conjugate(b.start.rotation) * a.start.rotation);
    const Vec3<double> half = (turn.w < 0 ? -1 : 1) * turn.vector();
    const double sine = norm(half);
    const Vec3<double> axis = sine > 0 ? (1 / sine) * half : Vec3<double>{0, 0, 1};
    const double angle = 2 * std::atan2(sine, std::abs(turn.w));
    const double expected = dot(axis, transposed_times(rotation_matrix(b.pose.rotation), a.turn - b.turn));
    return {inverse_transform(b.pose, a.centre),
            inverse_transform(b.start, transform(a.start, inverse_transform(a.pose, a.centre))), axis,
            angle + 2 * M_PI * std::round((expected - angle) / (2 * M_PI))};
}

/// What touches in a step, and how it slips: where a ball rolls, another point in every instant. The slip is the turn
/// times the mean arm of what is at the contact, which goes from where it is at first to where it is at last along an
/// arc: of a point that stays the same one exactly the way that it goes, and of a ball that rolls zero.
void touch_in_step(const Feature& f, const ContactBody& a, const ContactBody& b, const RelativeTurn& turn,
                   FeatureContact& c) {
    const auto [there, surface] = touch_of(f, a.pose, c, *b.shape, b.pose, c.side);
    c.distance = surface.distance;
    const Vec3<double> there_before = f.radius > 0 ? touch_of(f, a.start, c, *b.shape, b.start, c.side).point
                                                   : transform(a.start, f.point + c.place * f.along);
    const Vec3<double> before = inverse_transform(b.start, there_before), now = inverse_transform(b.pose, there);
    const Vec3<double> first = cross(turn.axis, before - turn.centre_before),
                       last = cross(turn.axis, now - turn.centre);
    // Of an arc, the mean is the chord's middle times tan(x) / x, x half of what it spans about the axis.
    const double span = 0.5 * std::atan2(norm(cross(first, last)), dot(first, last));
    const double mean = span > 1e-4 ? std::tan(std::min(span, fitted::widest_span)) / span : 1;
    const Vec3<double> slip = turn.centre - turn.centre_before + (0.5 * turn.angle * mean) * (first + last);
    c.point_of_a = inverse_transform(a.pose, there);
    c.point_of_b = now - slip;
}

/// A way out of an object: its face there, in its frame.
struct Face {
    Vec3<double> normal{0, 0, 0};
    double reach = 0;  ///< from its middle [m]
};
using Faces = std::array<Face, 16>;
/// Those of a box, or both ends of a cylinder and its side towards x; unused ones have no normal.
Faces faces_of(const Shape& shape, const Vec3<double>& x) {
    Faces faces;
    if (shape.kind == ShapeKind::cylinder) {
        faces[0] = {{0, 0, 1}, shape.size.y};
        faces[1] = {{0, 0, -1}, shape.size.y};
        const double beside = std::hypot(x.x, x.y);
        if (beside > 0) faces[2] = {{x.x / beside, x.y / beside, 0}, shape.size.x};
        return faces;
    }
    for (std::size_t i = 0; i < 6; ++i) {
        faces[i].normal[int(i / 2)] = i % 2 == 0 ? 1 : -1;
        faces[i].reach = shape.size[int(i / 2)];
    }
    return faces;
}

/// Of another object the planes at which the features inside it, and a's middle, are nearest to its surface, as far as
/// they differ. (Of a box on which a narrower can stands, only edges at the can's sides may be inside the can.)
Faces faces_met(const BodyPair& pair, const std::vector<Feature>& features, const ContactBody& a,
                const ContactBody& b) {
    Faces faces;
    std::size_t count = 0;
    const Mat3<double> R = rotation_matrix(b.start.rotation);
    auto add = [&](const Vec3<double>& point, const SurfacePoint<double>& at) {
        const Vec3<double> n = transposed_times(R, (1 / std::max(norm(at.normal), 1e-6)) * at.normal);
        const double reach = dot(n, inverse_transform(b.start, point)) - at.distance;
        if (count < faces.size() && std::none_of(faces.begin(), faces.begin() + std::ptrdiff_t(count),
                                                 [&](const Face& f) { return dot(f.normal, n) > fitted::same_face; }))
            faces[count++] = {n, reach};
    };
    add(a.start.position, surface_point(*b.shape, b.start, a.start.position));
    for (std::size_t i = 0; i < features.size(); ++i) {
        if (pair.contacts[i].undone <= 0) continue;
        const Touch at = touch_of(features[i], a.start, pair.contacts[i], *b.shape, b.start, 0);
        add(at.point, at.surface);
    }
    return faces;
}

/// Where a step would carry a feature through an object, or past its middle, the face that it meets first is the
/// object's surface for this step: the plane through the point that is met, which moves with that point and does not
/// turn, so that what is round is not turned by it. (Boxes and ends of discs remember their sides instead.)
enum class Within { may_be, must_be };  ///< where the nearest face of a point inside is the one it came through
void stop_at_first_face(const Feature& f, const ContactBody& a, const ContactBody& b, FeatureContact& c, double travel,
                        Within within) {
    if (b.shape->kind == ShapeKind::plane || c.side != 0 || travel < fitted::least_crossing) return;
    const Vec3<double> point = f.point + c.place * f.along;
    const Vec3<double> from = inverse_transform(b.start, transform(a.start, point)),
                       path = inverse_transform(b.pose, transform(a.pose, point)) - from;
    const Vec3<double> axis =
        transposed_times(rotation_matrix(b.start.rotation), rotation_matrix(a.start.rotation) * f.axis);
    const Pose<double> own{{0, 0, 0}, Quaternion<double>::identity()};
    auto gap = [&](const SurfacePoint<double>& at) {
        return at.distance - f.radius * norm(at.normal - dot(at.normal, axis) * axis);
    };
    SurfacePoint<double> met = surface_point(*b.shape, own, from);
    if (gap(met) > travel || gap(met) < -fitted::overlap_begins) return;
    Vec3<double> where = from;
    bool touches = false;
    for (int i = 1; i <= fitted::crossing_samples && !touches; ++i) {
        const Vec3<double> x = from + (double(i) / fitted::crossing_samples) * path;
        const SurfacePoint<double> there = surface_point(*b.shape, own, x);
        touches = gap(there) < 0;
        if (there.distance > 0) met = there, where = x;
    }
    if (!touches) return;
    const Vec3<double> normal = (1 / std::max(norm(met.normal), 1e-6)) * met.normal;
    const SurfacePoint<double> end = surface_point(*b.shape, own, from + path);
    if ((end.distance > 0 || within == Within::may_be) && dot(normal, end.normal) > fitted::one_face) return;
    c.face = rotation_matrix(b.start.rotation) * normal;
    c.met = where - met.distance * normal;
}

}  // namespace

void begin_pair(BodyPair& pair, const std::vector<Feature>& features, const ContactBody& a, const ContactBody& b) {
    const RelativeTurn turn = relative_turn(a, b);
    for (std::size_t i = 0; i < features.size(); ++i) {
        FeatureContact& c = pair.contacts[i];
        c.exit = c.face = {0, 0, 0};
        if (dot(features[i].along, features[i].along) > 0)
            c.place = deepest_place(features[i], c, a.pose, *b.shape, b.pose);
        const double give = c.normal_multiplier / pair.penalty;
        c.blunt = std::clamp(fitted::blunt_per_give * give / std::max(features[i].radius, 1e-6), fitted::least_blunt,
                             fitted::most_blunt);
        const Vec3<double> point = features[i].point + c.place * features[i].along;
        const Vec3<double> middle = inverse_transform(b.start, transform(a.start, point));
        const double travel = norm(inverse_transform(b.pose, transform(a.pose, point)) - middle);
        const Vec3<double> facing =
            transposed_times(rotation_matrix(b.start.rotation), rotation_matrix(a.start.rotation) * features[i].facing);
        c.side = side_of_surface(*b.shape, middle, facing, c.side, travel);
        set_rim(features[i], a, b, c);
        stop_at_first_face(features[i], a, b, c, travel, Within::must_be);
        touch_in_step(features[i], a, b, turn, c);
    }
}

void stop_falls(BodyPair& pair, const std::vector<Feature>& features, const ContactBody& a, const ContactBody& b,
                const Pose<double>& a_falls, const Pose<double>& b_falls) {
    auto fall = [](const ContactBody& o, const Pose<double>& pose) { return norm(pose.position - o.pose.position); };
    if (std::max(fall(a, a_falls), fall(b, b_falls)) < fitted::least_crossing) return;
    // Either may be held where it is by something else.
    ContactBody falling_a = a, falling_b = b;
    falling_a.pose = a_falls, falling_b.pose = b_falls;
    const RelativeTurn turn = relative_turn(a, b);
    for (std::size_t i = 0; i < features.size(); ++i) {
        FeatureContact& c = pair.contacts[i];
        const Vec3<double> point = features[i].point + c.place * features[i].along;
        using Both = std::pair<const ContactBody*, const ContactBody*>;
        for (auto [of_a, of_b] : {Both{&falling_a, &b}, Both{&a, &falling_b}, Both{&falling_a, &falling_b}}) {
            if (dot(c.face, c.face) > 0) break;
            const Vec3<double> from = inverse_transform(b.start, transform(a.start, point)),
                               to = inverse_transform(of_b->pose, transform(of_a->pose, point));
            stop_at_first_face(features[i], *of_a, *of_b, c, norm(to - from), Within::may_be);
        }
        if (dot(c.face, c.face) > 0) touch_in_step(features[i], a, b, turn, c);
    }
}

SurfacePoint<double> surface_at(const FeatureContact& c, const Shape& b, const Pose<double>& pose,
                                const Vec3<double>& point, int side) {
    if (dot(c.face, c.face) > 0) return {dot(c.face, point - transform(pose, c.met)), c.face};
    if (dot(c.exit, c.exit) <= 0) return surface_point(b, pose, point, side);
    const Vec3<double> normal = rotation_matrix(pose.rotation) * c.exit;
    return {dot(normal, point - pose.position) - c.reach, normal};
}

bool find_exit_face(BodyPair& pair, const std::vector<Feature>& features, const ContactBody& a, const ContactBody& b) {
    if (b.shape->kind == ShapeKind::plane) return false;
    Vec3<double> first{0, 0, 0};
    bool one_face = true;
    for (std::size_t i = 0; i < features.size(); ++i) {
        const FeatureContact& c = pair.contacts[i];
        if (c.undone <= 0) continue;
        const Vec3<double> n = touch_of(features[i], a.start, c, *b.shape, b.start, 0).surface.normal;
        if (dot(first, first) <= 0) first = n;
        one_face &= dot(first, n) > fitted::one_face;
    }
    if (one_face) return false;
    double least = HUGE_VAL;
    FeatureContact best;
    const Faces faces = has_sides(b.shape->kind) ? faces_of(*b.shape, inverse_transform(b.start, a.start.position))
                                                 : faces_met(pair, features, a, b);
    for (const Face& face : faces) {
        FeatureContact out;
        out.exit = face.normal, out.reach = face.reach;
        double deepest = dot(face.normal, face.normal) > 0 ? 0 : HUGE_VAL;
        for (std::size_t i = 0; i < features.size(); ++i) {
            if (pair.contacts[i].undone <= 0) continue;
            out.place = pair.contacts[i].place, out.blunt = pair.contacts[i].blunt;
            deepest = std::max(deepest, -touch_of(features[i], a.start, out, *b.shape, b.start, 0).surface.distance);
        }
        if (deepest < least) least = deepest, best = out;
    }
    const RelativeTurn turn = relative_turn(a, b);
    for (std::size_t i = 0; i < features.size(); ++i) {
        FeatureContact& c = pair.contacts[i];
        if (c.undone <= 0) continue;
        c.exit = best.exit, c.reach = best.reach, c.rim = {0, 0, 0};
        touch_in_step(features[i], a, b, turn, c);
    }
    return true;
}

void undo_overlap(FeatureContact& c, double overlap, double begins, double recovery) {
    const double ends = std::min({begins, fitted::overlap_ends, fitted::overlap_ends_share * recovery});
    const bool undo = overlap > (c.undone > 0 ? ends : begins);
    c.offset = undo ? std::min(0.0, recovery - overlap) : 0;
    c.undone = undo ? std::min(overlap, recovery) : 0;
    if (undo) c.normal_multiplier = 0;
}

PairEvaluation evaluate_pair(BodyPair& pair, const std::vector<Feature>& features, const ContactBody& a,
                             const ContactBody& b, double exactness) {
    PairEvaluation out;
    const Mat3<double> R = rotation_matrix(b.pose.rotation);
    // Which of several points bears how much of a load hangs on gaps that rounding makes: no update ever settles it.
    const double rounding = pair.penalty * fitted::rounded_gap;
    auto pending_of = [&](double change) { return std::abs(change) > rounding ? change * change : 0; };
    for (std::size_t i = 0; i < features.size(); ++i) {
        FeatureContact& c = pair.contacts[i];
        auto [point, surface] = touch_of(features[i], a.pose, c, *b.shape, b.pose, c.side);
        c.distance = surface.distance;
        surface.distance -= c.offset;
        const bool met = dot(c.face, c.face) > 0;
        const Vec3<double> point_of_b = met ? transform(b.pose, c.met) : point;
        PairTerm &push = c.terms[0], &rub = c.terms[1];
        push.arm_of_a = point - a.centre, push.arm_of_b = point_of_b - b.centre;
        ContactTerms<double> normal{0, {0, 0, 0}, Mat3<double>::zero(), 0, {0, 0, 0}};
        if (!(c.normal_multiplier <= 0 && surface.distance >= 0))
            normal = normal_terms(surface, pair.penalty, c.normal_multiplier);
        push.acts = !(normal.normal_force == 0), rub.acts = false;
        if (push.acts) push.gradient = normal.gradient, push.curvature = normal.curvature;
        c.normal_candidate = normal.normal_force;
        c.normal_now = (1 / std::max(norm(surface.normal), 1e-6)) * transposed_times(R, surface.normal);
        out.energy += normal.energy;
        out.contact_force += normal.normal_force;
        if (c.undone <= 0) {
            out.penetration = std::max(out.penetration, -surface.distance);
            out.pending += pending_of(normal.normal_force - c.normal_multiplier);
        }
        if (pair.friction <= 0) continue;
        const bool rubs = !(c.friction_radius == 0);
        if (!rubs && normal.normal_force == 0 && dot(c.tangential_multiplier, c.tangential_multiplier) == 0) {
            c.tangential_candidate = {0, 0, 0};
            continue;
        }
        const Vec3<double> touched = transform(a.pose, c.point_of_a);
        const Vec3<double> slip = R * (inverse_transform(b.pose, touched) - c.point_of_b);
        const ContactState<double> state{c.normal_multiplier, R * c.tangential_multiplier, c.friction_radius,
                                         R * c.friction_normal};
        ContactTerms<double> friction{0, {0, 0, 0}, Mat3<double>::zero(), 0, {0, 0, 0}};
        add_friction(slip, pair.penalty, state, exactness, friction);
        rub = {friction.gradient, friction.curvature, touched - a.centre, touched - b.centre, rubs};
        c.tangential_candidate = transposed_times(R, friction.tangential);
        out.energy += friction.energy;
        const Vec3<double> dt = friction.tangential - state.tangential_multiplier;
        const double dr = pair.friction * normal.normal_force - c.friction_radius;
        out.pending += dot(dt, dt) + pending_of(dr);
    }
    return out;
}

void update_pair(BodyPair& pair, bool at_end_of_step) {
    for (FeatureContact& c : pair.contacts) {
        if (c.undone <= 0 || at_end_of_step) c.normal_multiplier = c.normal_candidate;
        c.tangential_multiplier = c.tangential_candidate;
        c.friction_radius = pair.friction * c.normal_candidate;
        c.friction_normal = c.normal_now;
    }
    pair.penalty = std::max(pair.penalty, load_penalty(pair));
}

double load_penalty(const BodyPair& pair) {
    double load = 0;
    for (const FeatureContact& c : pair.contacts)
        if (c.undone <= 0) load += c.normal_multiplier;
    return load / fitted::deepest_under_load;
}

}  // namespace palpate
