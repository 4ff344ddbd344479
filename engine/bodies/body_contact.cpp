#include "engine/bodies/body_contact.h"

#include <algorithm>
#include <cmath>

#include "engine/bodies/fitted.h"
#include "engine/contact/sides.h"

namespace palpate {

namespace {

/// Heights along an axis, ends included, about a diameter apart, at most 17.
std::vector<double> along_axis(double half_length, double radius, int fewest_gaps) {
    const int gaps = std::clamp(int(std::ceil(half_length / radius)), fewest_gaps, 16);
    std::vector<double> heights;
    for (int i = 0; i <= gaps; ++i) heights.push_back(half_length * (2.0 * i / gaps - 1));
    return heights;
}

}  // namespace

std::vector<Feature> features_of(const Shape& shape, bool against_planes) {
    const Vec3<double>& s = shape.size;
    std::vector<Feature> out;
    switch (shape.kind) {
        case ShapeKind::plane:
            break;
        case ShapeKind::box: {
            // Corners are round, by a little: where boxes of one size lie flush, sharp corners would sit on edges, from
            // where up is no nearer than out.
            const double r = std::min(1e-3, 0.05 * std::min({s.x, s.y, s.z}));
            const Vec3<double> c{s.x - r, s.y - r, s.z - r};
            for (int i = -1; i <= 1; ++i)
                for (int j = -1; j <= 1; ++j)
                    for (int k = -1; k <= 1; ++k)
                        if (i || j || k) out.push_back({{i * c.x, j * c.y, k * c.z}, r, {0, 0, 0}, 0});
            break;
        }
        case ShapeKind::sphere:
            out.push_back({{0, 0, 0}, s.x, {0, 0, 0}, 0});
            break;
        case ShapeKind::capsule:
            for (double z : along_axis(s.y, s.x, 1)) out.push_back({{0, 0, z}, s.x, {0, 0, 0}, 0});
            break;
        case ShapeKind::cylinder:
            // A disc in the middle, too: those at the ends of two that stand beside each other are flush with both.
            for (double z : along_axis(s.y, s.x, 2))
                if (std::abs(z) < s.y) out.push_back({{0, 0, z}, s.x, {0, 0, 1}, 0});
            for (double end : {-s.y, s.y})
                for (double angle : {0.0, 2.0943951023931953, -2.0943951023931953})
                    out.push_back({{0, 0, end}, s.x, {0, 0, 1}, angle});
            break;
        case ShapeKind::mesh:
            if (against_planes)
                for (const Vec3<double>& p : shape.mesh->support) out.push_back({p, 0, {0, 0, 0}, 0});
            else
                for (const DistanceMesh::Ball& b : shape.mesh->balls) out.push_back({b.centre, b.radius, {0, 0, 0}, 0});
            break;
    }
    return out;
}

namespace {

/// The point of a feature that is deepest in b, world.
Vec3<double> deepest_point(const Feature& f, const Pose<double>& a, const FeatureContact& c, const Shape& shape,
                           const Pose<double>& b) {
    const Vec3<double> middle = transform(a, f.point);
    if (f.radius <= 0) return middle;
    Vec3<double> n = surface_at(c, shape, b, middle, c.side).normal;
    if (shape.kind == ShapeKind::mesh)
        n = (1 / std::max(norm(n), 1e-6)) * n;  // a smooth field's is of length one nearby
    if (dot(f.axis, f.axis) <= 0) return middle - f.radius * n;
    const Mat3<double> R = rotation_matrix(a.rotation);
    const Vec3<double> axis = R * f.axis;
    Vec3<double> out = n - dot(n, axis) * axis;
    double length = norm(out);
    if (length < 1e-9) {  // it stands upright: any three points of the rim do
        out = cross(axis, std::abs(f.axis.x) < 0.5 ? R.column(0) : R.column(1));
        length = norm(out);
    }
    out = (1 / length) * out;
    const Vec3<double> turned = std::cos(f.angle) * out + std::sin(f.angle) * cross(axis, out);
    return middle - f.radius * turned;
}

/// What touches at the start of a step.
void touch_at_start(const Feature& f, const ContactBody& a, const ContactBody& b, FeatureContact& c) {
    const Vec3<double> point = deepest_point(f, a.start, c, *b.shape, b.start);
    c.point_of_a = inverse_transform(a.start, point);
    c.point_of_b = inverse_transform(b.start, point);
}

/// A way out of an object: its face there, in its frame.
struct Face {
    Vec3<double> normal{0, 0, 0};
    double reach = 0;  ///< from its middle [m]
};
/// Those of a box, or both ends of a cylinder and its side towards x; unused ones have no normal.
std::array<Face, 6> faces_of(const Shape& shape, const Vec3<double>& x) {
    std::array<Face, 6> faces;
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

}  // namespace

void begin_pair(BodyPair& pair, const std::vector<Feature>& features, const ContactBody& a, const ContactBody& b) {
    for (std::size_t i = 0; i < features.size(); ++i) {
        FeatureContact& c = pair.contacts[i];
        const Vec3<double> middle = inverse_transform(b.start, transform(a.start, features[i].point));
        const double travel = norm(inverse_transform(b.pose, transform(a.pose, features[i].point)) - middle);
        c.side = side_in_step(*b.shape, middle, c.side, travel);
        c.way = {0, 0, 0};
        touch_at_start(features[i], a, b, c);
    }
}

SurfacePoint<double> surface_at(const FeatureContact& c, const Shape& b, const Pose<double>& pose,
                                const Vec3<double>& point, int side) {
    if (dot(c.way, c.way) <= 0) return surface_point(b, pose, point, side);
    const Vec3<double> normal = rotation_matrix(pose.rotation) * c.way;
    return {dot(normal, point - pose.position) - c.reach, normal};
}

bool find_way_out(BodyPair& pair, const std::vector<Feature>& features, const ContactBody& a, const ContactBody& b) {
    if (!has_sides(b.shape->kind)) return false;
    Vec3<double> first{0, 0, 0};
    bool one_face = true;
    for (const FeatureContact& c : pair.contacts) {
        if (c.undone <= 0) continue;
        const Vec3<double> n = surface_at(c, *b.shape, b.start, transform(a.start, c.point_of_a), 0).normal;
        if (dot(first, first) <= 0) first = n;
        one_face &= dot(first, n) > fitted::one_face;
    }
    if (one_face) return false;
    double least = HUGE_VAL;
    FeatureContact best;
    for (const Face& face : faces_of(*b.shape, inverse_transform(b.start, a.start.position))) {
        FeatureContact out;
        out.way = face.normal, out.reach = face.reach;
        double deepest = dot(face.normal, face.normal) > 0 ? 0 : HUGE_VAL;
        for (std::size_t i = 0; i < features.size(); ++i) {
            if (pair.contacts[i].undone <= 0) continue;
            const Vec3<double> point = deepest_point(features[i], a.start, out, *b.shape, b.start);
            deepest = std::max(deepest, -surface_at(out, *b.shape, b.start, point, 0).distance);
        }
        if (deepest < least) least = deepest, best = out;
    }
    for (std::size_t i = 0; i < features.size(); ++i) {
        FeatureContact& c = pair.contacts[i];
        if (c.undone <= 0) continue;
        c.way = best.way, c.reach = best.reach;
        touch_at_start(features[i], a, b, c);
    }
    return true;
}

void undo_overlap(FeatureContact& c, double overlap, double recovery) {
    const bool undo = overlap > (c.undone > 0 ? fitted::overlap_ends : fitted::overlap_begins);
    c.offset = undo ? std::min(0.0, recovery - overlap) : 0;
    c.undone = undo ? std::min(overlap, recovery) : 0;
    if (undo) c.normal_multiplier = 0;
}

PairEvaluation evaluate_pair(BodyPair& pair, const std::vector<Feature>& features, const ContactBody& a,
                             const ContactBody& b, double exactness) {
    PairEvaluation out;
    const Mat3<double> R = rotation_matrix(b.pose.rotation);
    for (std::size_t i = 0; i < features.size(); ++i) {
        FeatureContact& c = pair.contacts[i];
        const Vec3<double> point = deepest_point(features[i], a.pose, c, *b.shape, b.pose);
        SurfacePoint<double> surface = surface_at(c, *b.shape, b.pose, point, c.side);
        c.distance = surface.distance;
        surface.distance -= c.offset;
        const ContactTerms<double> normal = normal_terms(surface, pair.penalty, c.normal_multiplier);
        c.terms[0] = {normal.gradient, normal.curvature, point - a.centre, point - b.centre};
        c.terms[1] = {};
        c.normal_candidate = normal.normal_force;
        c.normal_now = (1 / std::max(norm(surface.normal), 1e-6)) * transposed_times(R, surface.normal);
        out.energy += normal.energy;
        out.contact_force += normal.normal_force;
        if (c.undone <= 0) {
            out.penetration = std::max(out.penetration, -surface.distance);
            const double change = normal.normal_force - c.normal_multiplier;
            out.pending += change * change;
        }
        if (pair.friction <= 0) continue;
        const Vec3<double> touched = transform(a.pose, c.point_of_a);
        const Vec3<double> slip = R * (inverse_transform(b.pose, touched) - c.point_of_b);
        const ContactState<double> state{c.normal_multiplier, R * c.tangential_multiplier, c.friction_radius,
                                         R * c.friction_normal};
        ContactTerms<double> friction{0, {0, 0, 0}, Mat3<double>::zero(), 0, {0, 0, 0}};
        add_friction(slip, pair.penalty, state, exactness, friction);
        c.terms[1] = {friction.gradient, friction.curvature, touched - a.centre, touched - b.centre};
        c.tangential_candidate = transposed_times(R, friction.tangential);
        out.energy += friction.energy;
        const Vec3<double> dt = friction.tangential - state.tangential_multiplier;
        const double dr = pair.friction * normal.normal_force - c.friction_radius;
        out.pending += dot(dt, dt) + dr * dr;
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
