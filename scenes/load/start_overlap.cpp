#include "scenes/load/start_overlap.h"

#include <algorithm>
#include <cmath>

#include "engine/bodies/body_contact.h"
#include "meshes/plain_numbers.h"
#include "meshes/triangle_tree.h"

namespace palpate {

namespace {

Vec3<double> vec(const Point& p) { return {p[0], p[1], p[2]}; }
Eigen::Vector3d eigen(const Vec3<double>& v) { return {v.x, v.y, v.z}; }

std::string mm_text(double metres) {
    char text[32];
    plain_snprintf(text, sizeof text, "%.2g mm", 1e3 * metres);
    if (metres >= 0.1) plain_snprintf(text, sizeof text, "%.0f mm", 1e3 * metres);
    return text;
}

double thickness(const TetMesh& mesh) {
    double low = HUGE_VAL, high = -HUGE_VAL;
    for (const Point& p : mesh.nodes) low = std::min(low, p[2]), high = std::max(high, p[2]);
    return high - low;
}

bool inside(const TetMesh& mesh, const std::array<int, 4>& tet, const Eigen::Vector3d& x) {
    auto node = [&](int k) { return eigen(vec(mesh.nodes[std::size_t(tet[std::size_t(k)])])); };
    Eigen::Matrix3d edges;
    for (int k = 0; k < 3; ++k) edges.col(k) = node(k + 1) - node(0);
    const Eigen::Vector3d b = edges.partialPivLu().solve(x - node(0));
    return b.minCoeff() >= 0 && b.sum() <= 1;
}

/// How deep the features of a lie in b [m].
double feature_depth(const ObjectSpec& a, const ObjectSpec& b) {
    double depth = -HUGE_VAL;
    auto take = [&](const Vec3<double>& local, double radius) {
        depth = std::max(depth, radius - surface_point(b.shape, b.pose, transform(a.pose, local)).distance);
    };
    for (const Feature& f : features_of(a.shape, b.shape.kind == ShapeKind::plane)) {
        if (!(dot(f.axis, f.axis) > 0)) {
            take(f.point, f.radius);
            continue;
        }
        constexpr int around = 16;  // places on the rim of a disc, whose axis is z
        for (int i = 0; i < around; ++i) {
            const double angle = 2 * unit::pi * i / around;
            take(f.point + f.radius * Vec3<double>{std::cos(angle), std::sin(angle), 0}, 0);
        }
    }
    return depth;
}

/// Whether an object lies under the skin, between nodes: its nearest point to a node of the pad is straight inward.
bool lies_inside(const FingerSpec& f, const ObjectSpec& o) {
    constexpr double within = 1e-3, straight = 0.7;
    std::vector<Eigen::Vector3d> outward(f.mesh.nodes.size(), Eigen::Vector3d::Zero());
    for (const auto& t : f.mesh.surface) {
        auto node = [&](int k) { return eigen(vec(f.mesh.nodes[std::size_t(t[std::size_t(k)])])); };
        const Eigen::Vector3d area = (node(1) - node(0)).cross(node(2) - node(0));
        for (int i : t) outward[std::size_t(i)] += area;
    }
    const Mat3<double> R = rotation_matrix(f.start.rotation);
    return std::any_of(f.mesh.pad_nodes.begin(), f.mesh.pad_nodes.end(), [&](int i) {
        const Vec3<double> x = transform(f.start, vec(f.mesh.nodes[std::size_t(i)]));
        const SurfacePoint<double> s = surface_point(o.shape, o.pose, x);
        const Eigen::Vector3d& out = outward[std::size_t(i)];
        return s.distance >= 0 && s.distance < within &&
               dot(s.normal, R * Vec3<double>{out.x(), out.y(), out.z()}) > straight * out.norm();
    });
}

/// What comes of an overlap.
std::string remedy(const Scene& scene) {
    char text[80];
    plain_snprintf(text, sizeof text, "it comes out at %.3g mm/s (solver.recovery_speed_mm_per_s)",
                   1e3 * scene.spec.solver.recovery_speed);
    return text;
}

/// Nobody places a finger within 0.3 mm of the origin, but many give metres.
bool in_metres(const FingerSpec& f) {
    const Vec3<double>& p = f.start.position;
    const double far = std::max({std::abs(p.x), std::abs(p.y), std::abs(p.z)});
    return far > 0 && far < 3e-4;
}
constexpr const char* metres_hint = "; its position looks like metres, and mm are expected";

/// How far apart samples of a pad are: the middle one of its edges [m].
double between_samples(const TetMesh& mesh) {
    std::vector<double> edges;
    auto in_pad = [&](int i) { return std::binary_search(mesh.pad_nodes.begin(), mesh.pad_nodes.end(), i); };
    for (const auto& t : mesh.surface)
        for (std::size_t k = 0; k < 3; ++k)
            if (const int a = t[k], b = t[(k + 1) % 3]; in_pad(a) && in_pad(b))
                edges.push_back(norm(vec(mesh.nodes[std::size_t(a)]) - vec(mesh.nodes[std::size_t(b)])));
    if (edges.empty()) return 0;
    std::nth_element(edges.begin(), edges.begin() + std::ptrdiff_t(edges.size() / 2), edges.end());
    return edges[edges.size() / 2];
}

/// How wide an object is that may pass between samples [m]; of a mesh that is not known.
double width(const Shape& shape) {
    std::array<double, 3> e{shape.size.x, shape.size.y, shape.size.z};
    switch (shape.kind) {
        case ShapeKind::sphere:
        case ShapeKind::capsule:
        case ShapeKind::cylinder:
            return 2 * shape.size.x;
        case ShapeKind::box:
            std::sort(e.begin(), e.end());
            return 2 * e[1];
        default:
            return HUGE_VAL;
    }
}

/// What is not much wider than samples are apart is felt by few of them: too weakly, or not at all (balls, rods and
/// bars of 4 mm on pads with samples 3.7 mm apart: nothing to 0.8 of the force on finer ones).
void check_narrow_objects(const Scene& scene, Problems& problems) {
    constexpr double times = 1.5, in_metres = 3e-4;  // what is that small is in metres, which is said
    const FingerSpec* coarsest = nullptr;
    double apart = 0;
    for (const FingerSpec& f : scene.spec.fingers)
        if (const double own = between_samples(f.mesh) / scene.spec.solver.sample_refinement; own > apart)
            apart = own, coarsest = &f;
    for (const ObjectSpec& o : scene.spec.objects)
        if (coarsest && !o.tissue && width(o.shape) > in_metres && width(o.shape) < times * apart)
            problems.warnings.push_back(problems.placed(
                nullptr, "object \"" + o.name + "\" is " + mm_text(width(o.shape)) + " wide, and samples of finger \"" +
                             coarsest->name + "\" are " + mm_text(apart) +
                             " apart: what is so narrow is felt too weakly, hooks the skin, or passes between them "
                             "unfelt; a larger solver.sample_refinement, or more elements, bring them nearer"));
}

/// How wide an object is that tissue may let in between its samples; a mesh is as wide as the box around it [m].
double width_on_tissue(const ObjectSpec& o) {
    if (o.shape.kind != ShapeKind::mesh || !o.mesh) return width(o.shape);
    Point low{HUGE_VAL, HUGE_VAL, HUGE_VAL}, high{-HUGE_VAL, -HUGE_VAL, -HUGE_VAL};
    for (const Point& p : o.mesh->surface.vertices)
        for (std::size_t d = 0; d < 3; ++d) low[d] = std::min(low[d], p[d]), high[d] = std::max(high[d], p[d]);
    std::array<double, 3> size{high[0] - low[0], high[1] - low[1], high[2] - low[2]};
    std::sort(size.begin(), size.end());
    return size[1];
}

/// On tissue what is less than three times as wide as samples are apart hangs at single nodes, or comes in between them
/// (of balls of 4, 6, 8 and 12 mm on samples 4.2 mm apart, that slide where nothing holds them, the first fell through
/// the slab, and the others went 0.02, 0.3 and 0.7 of the way).
void check_narrow_on_tissue(const Scene& scene, Problems& problems) {
    constexpr double times = 3, in_metres = 3e-4;
    const auto& objects = scene.spec.objects;
    const auto moves = [&](std::size_t i) {
        return objects[i].body || (i < scene.object_motions.size() && !scene.object_motions[i].empty());
    };
    for (std::size_t k = 0; k < objects.size(); ++k) {
        if (!objects[k].tissue) continue;
        const double apart = between_samples(objects[k].tissue->mesh) / tissue_refinement(scene.spec);
        for (std::size_t i = 0; i < objects.size(); ++i) {
            const double wide = width_on_tissue(objects[i]);
            if (objects[i].tissue || !(moves(i) || moves(k)) || !(wide > in_metres) || !(wide < times * apart))
                continue;
            problems.warnings.push_back(problems.placed(
                nullptr, "object \"" + objects[i].name + "\" is " + mm_text(wide) +
                             " wide, and samples of soft object \"" + objects[k].name + "\" are " + mm_text(apart) +
                             " apart: where it touches that, single samples hold it, or it comes in between them; more "
                             "soft.elements, or a larger solver.sample_refinement, bring them nearer"));
        }
    }
}

void check_fingers_in_objects(const Scene& scene, Problems& problems, const PosesNow& now) {
    for (const FingerSpec& f : scene.spec.fingers)
        for (const ObjectSpec& o : scene.spec.objects) {
            if (now.fingers.contains(f.name) && now.objects.contains(o.name)) continue;
            if (scene.tracker.empty() && lies_inside(f, o)) {
                problems.add(nullptr, "object \"" + o.name + "\" starts inside finger \"" + f.name +
                                          "\", under its skin: let its track begin outside");
                continue;
            }
            const double depth = start_depth(f, o), most = 0.5 * thickness(f.mesh);
            if (!(depth > finger_depth_said)) continue;
            const std::string what =
                "finger \"" + f.name + "\" starts " + mm_text(depth) + " inside object \"" + o.name + "\"";
            // A live hand is elsewhere as soon as it is seen.
            if (depth > most && scene.tracker.empty())
                problems.add(nullptr, what + ", deeper than half its thickness (" + mm_text(most) +
                                          "): let its track begin outside" + (in_metres(f) ? metres_hint : ""));
            else
                problems.warnings.push_back(problems.placed(nullptr, what + ": " + remedy(scene)));
        }
}

void check_bodies(const Scene& scene, Problems& problems, const PosesNow& now) {
    const auto& objects = scene.spec.objects;
    for (std::size_t i = 0; i < objects.size(); ++i)
        for (std::size_t j = i + 1; j < objects.size(); ++j) {
            if (!objects[i].body && !objects[j].body) continue;
            if (now.objects.contains(objects[i].name) && now.objects.contains(objects[j].name)) continue;
            const double depth = start_depth(objects[i], objects[j]);
            if (!(depth > body_depth_said)) continue;
            const std::string what = "objects \"" + objects[i].name + "\" and \"" + objects[j].name + "\" overlap by " +
                                     mm_text(depth) + " at the start";
            if (depth > body_depth_refused)
                problems.add(nullptr, what + ": bodies that overlap by more than " + mm_text(body_depth_refused) +
                                          " would be thrown apart");
            else
                problems.warnings.push_back(problems.placed(nullptr, what));
        }
}

/// Around a finger where it starts, world.
Sphere sphere_around(const FingerSpec& f) {
    Sphere out{f.start.position, 0};
    for (const Point& p : f.mesh.nodes) out.radius = std::max(out.radius, norm(vec(p)));
    return out;
}

void check_fingers_in_fingers(const Scene& scene, Problems& problems, const PosesNow& now) {
    const auto& fingers = scene.spec.fingers;
    std::vector<Sphere> around;
    for (const FingerSpec& f : fingers) around.push_back(sphere_around(f));
    for (std::size_t i = 0; i < fingers.size(); ++i)
        for (std::size_t j = i + 1; j < fingers.size(); ++j) {
            if (norm(around[i].centre - around[j].centre) > around[i].radius + around[j].radius) continue;
            if (now.fingers.contains(fingers[i].name) && now.fingers.contains(fingers[j].name)) continue;
            const double depth = std::max(start_depth(fingers[i], fingers[j]), start_depth(fingers[j], fingers[i]));
            if (depth > finger_depth_said)
                problems.warnings.push_back(problems.placed(nullptr, "fingers \"" + fingers[i].name + "\" and \"" +
                                                                         fingers[j].name + "\" overlap by " +
                                                                         mm_text(depth) + " at the start"));
        }
}

}  // namespace

double start_depth(const FingerSpec& f, const ObjectSpec& o) {
    double depth = -HUGE_VAL;
    for (int node : f.mesh.pad_nodes) {
        const Vec3<double> x = transform(f.start, vec(f.mesh.nodes[std::size_t(node)]));
        depth = std::max(depth, -surface_point(o.shape, o.pose, x).distance);
    }
    return depth;
}

double start_depth(const ObjectSpec& a, const ObjectSpec& b) {
    return std::max(feature_depth(a, b), feature_depth(b, a));
}

double start_depth(const FingerSpec& a, const FingerSpec& b) {
    Eigen::AlignedBox3d box;
    for (const Point& p : b.mesh.nodes) box.extend(eigen(vec(p)));
    std::vector<Eigen::Vector3d> in_box;
    for (int node : a.mesh.pad_nodes) {
        const Vec3<double> x = transform(a.start, vec(a.mesh.nodes[std::size_t(node)]));
        if (const Eigen::Vector3d local = eigen(inverse_transform(b.start, x)); box.contains(local))
            in_box.push_back(local);
    }
    if (in_box.empty()) return -HUGE_VAL;
    const TriangleTree tree({b.mesh.nodes, b.mesh.surface});
    // Some hundred of the points tell the depth well enough, however fine the meshes.
    const std::size_t stride = 1 + in_box.size() / 200;
    double depth = -HUGE_VAL;
    for (std::size_t i = 0; i < in_box.size(); i += stride) {
        const Eigen::Vector3d& x = in_box[i];
        const double distance = (tree.nearest(x) - x).norm();
        if (distance > depth &&
            std::any_of(b.mesh.tets.begin(), b.mesh.tets.end(), [&](const auto& t) { return inside(b.mesh, t, x); }))
            depth = distance;
    }
    return depth;
}

void check_start(const Scene& scene, Problems& problems, const PosesNow* now) {
    const PosesNow none, &known = now ? *now : none;
    check_fingers_in_objects(scene, problems, known);
    if (!now) check_narrow_objects(scene, problems), check_narrow_on_tissue(scene, problems);
    check_bodies(scene, problems, known);
    check_fingers_in_fingers(scene, problems, known);
}

}  // namespace palpate
