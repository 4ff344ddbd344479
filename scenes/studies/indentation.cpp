#include "scenes/studies/indentation.h"

#include <algorithm>
#include <cmath>

#include "engine/contact/contact_edge.h"
#include "engine/step.h"
#include "meshes/curved_skin.h"
#include "meshes/surface.h"
#include "scenes/trackers/trajectory.h"

namespace palpate {

namespace {

/// Walls at strain limits are about as stiff; a hundred times stiffer, steps on them do not converge.
constexpr double clamp_stiffness = 1 / clamp_give, clamp_angular_stiffness = 1e3;

SceneSpec plate_and_fingers(const std::vector<Indentation>& fingers, const IndentationSettings& s) {
    SceneSpec spec;
    spec.solver.inertia = s.speed > 0;
    if (s.speed > 0) spec.solver.dt = std::clamp(fingers[0].depth / s.steps / s.speed, 1e-6, 0.2);
    spec.solver.tolerance = s.tolerance;
    spec.solver.multiplier_tolerance = 10 * s.tolerance;
    spec.solver.sleep_speed = 0;
    for (const Indentation& i : fingers) {
        FingerSpec& f = spec.fingers.emplace_back(i.finger);
        f.coupling = Coupling{};
        f.coupling.stiffness = clamp_stiffness;
        f.coupling.angular_stiffness = clamp_angular_stiffness;
        f.coupling.max_force = 1e5;
        f.coupling.max_torque = 1e4;
        f.filter.reset();
        f.single_precision = false;
        f.start.rotation = from_roll_pitch_yaw(i.roll, i.angle, 0.0);
        const Vec3<double> down = transposed_times(rotation_matrix(f.start.rotation), Vec3<double>{0, 0, -1});
        f.start.position = {0, 0, reach_of_curved_skin(f.mesh, {down.x, down.y, down.z})};
    }
    ObjectSpec plate;
    plate.name = "plate";
    plate.friction = s.friction;
    spec.objects.push_back(plate);
    return spec;
}

/// Principal strain, by magnitude, that a fiftieth of the skin exceeds, by area: of faces that lie on the plate with a
/// corner or more. The largest is a single face's, and another one's with each mesh.
double surface_strain(const TetMesh& mesh, const ContactSurface& contact) {
    std::vector<std::pair<double, double>> faces;  // strain, area
    double all = 0;
    for (const auto& t : contact.faces) {
        if (std::none_of(t.begin(), t.end(), [&](int s) { return contact.touches[std::size_t(s)]; })) continue;
        // Metric of the deformed triangle in an orthonormal frame of the triangle at rest.
        const auto rest = [&](std::size_t k) {
            const Point& p = mesh.nodes[std::size_t(mesh.pad_nodes[std::size_t(t[k])])];
            return Vec3<double>{p[0], p[1], p[2]};
        };
        const auto now = [&](std::size_t k) { return contact.position[std::size_t(t[k])]; };
        const Vec3<double> U = rest(1) - rest(0), V = rest(2) - rest(0), u = now(1) - now(0), v = now(2) - now(0);
        const double a = norm(U), b = dot(U, V) / a, c = std::sqrt(std::max(1e-300, dot(V, V) - b * b));
        const Vec3<double> f1 = (1 / a) * u, f2 = (1 / c) * (v - (b / a) * u);
        const double xx = dot(f1, f1), xy = dot(f1, f2), yy = dot(f2, f2);
        const double mean = 0.5 * (xx + yy), spread = std::hypot(0.5 * (xx - yy), xy);
        double strain = 0;
        for (double square : {mean + spread, mean - spread})
            strain = std::max(strain, std::abs(std::sqrt(std::max(0.0, square)) - 1));
        faces.push_back({strain, a * c / 2});
        all += faces.back().second;
    }
    std::sort(faces.rbegin(), faces.rend());
    double above = 0;
    for (const auto& [strain, area] : faces)
        if ((above += area) >= 0.02 * all) return strain;
    return 0;
}

/// The plate is level.
std::vector<std::array<double, 2>> outline_seen_from_above(const ContactSurface& contact) {
    std::vector<std::array<double, 2>> flat;
    for (const Vec3<double>& p : contact_outline(contact)) {
        const Vec3<double> x = transform(contact.bone, p);
        flat.push_back({x.x, x.y});
    }
    return flat;
}

IndentationPoint read_point(const World& world, std::size_t finger, const FingerSpec& f) {
    const EntityId id = world.skins.owner(finger);
    const ContactSurface& contact = world.contact_surfaces[finger];
    const SkinStatus& status = skin_status(world, id);
    IndentationPoint p;
    p.displacement = f.start.position.z - contact.bone.position.z;
    p.force = contact.total.z;
    p.area = contact.touching_area;
    p.hull = hull_area(outline_seen_from_above(contact));
    p.surface_strain = surface_strain(f.mesh, contact);
    p.touching = contact.touching;
    p.limited = status.limited_elements;
    p.converged = status.converged && !status.reset;
    return p;
}

/// A finger's tracked pose: its start, lowered and shifted.
void place(World& world, std::size_t finger, const FingerSpec& f, double lowered, double shifted) {
    TrackerPose::Sample& s = world.tracker_poses[finger].incoming;
    s.pose = f.start;
    s.pose.position.z -= lowered;
    s.pose.position.y += shifted;
    s.time = world.time;
    s.valid = true;
}

}  // namespace

std::vector<IndentationCurve> indent(const std::vector<Indentation>& fingers, const IndentationSettings& s,
                                     Threads& threads) {
    const SceneSpec spec = plate_and_fingers(fingers, s);
    World world = build_world(spec);
    const std::size_t count = fingers.size();
    std::vector<IndentationCurve> curves(count);
    for (IndentationCurve& c : curves) c.points.push_back({.converged = true});
    std::vector<double> lowered(count, 0.0);
    for (std::size_t k = 1;; ++k) {
        std::vector<char> goes_on(count);
        for (std::size_t i = 0; i < count; ++i) {
            const std::vector<double>& stops = fingers[i].displacements;
            const std::size_t steps = stops.empty() ? std::size_t(s.steps) : stops.size();
            goes_on[i] = k <= steps && (s.force_limit <= 0 || curves[i].points.back().force <= s.force_limit);
            if (goes_on[i]) lowered[i] = stops.empty() ? fingers[i].depth * double(k) / s.steps : stops[k - 1];
            place(world, i, spec.fingers[i], lowered[i], 0);
        }
        if (std::find(goes_on.begin(), goes_on.end(), 1) == goes_on.end()) break;
        step(world, threads);
        if (s.progress) s.progress(std::min(1.0, double(k) / s.steps));
        for (std::size_t i = 0; i < count; ++i)
            if (goes_on[i]) {
                curves[i].points.push_back(read_point(world, i, spec.fingers[i]));
                if (s.observe) s.observe(i, curves[i].points.back(), world.contact_surfaces[i]);
            }
    }
    for (int k = 0; s.shear > 0 && k <= s.shear_steps; ++k) {
        if (k > 0) {
            for (std::size_t i = 0; i < count; ++i)
                place(world, i, spec.fingers[i], lowered[i], s.shear * k / s.shear_steps);
            step(world, threads);
        }
        for (std::size_t i = 0; i < count; ++i) {
            const ContactSurface& contact = world.contact_surfaces[i];
            const EntityId id = world.skins.owner(i);
            curves[i].shear.push_back({contact.bone.position.y, -contact.total.y,
                                       surface_strain(spec.fingers[i].mesh, contact),
                                       skin_status(world, id).converged});
        }
    }
    return curves;
}

double hull_area(std::vector<std::array<double, 2>> corners) {
    using Flat = std::array<double, 2>;
    auto cross = [](const Flat& o, const Flat& a, const Flat& b) {
        return (a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0]);
    };
    // Andrew's monotone chain.
    std::sort(corners.begin(), corners.end());
    std::vector<Flat> hull;
    for (int side = 0; side < 2; ++side) {
        const std::size_t begin = hull.size();
        for (const Flat& p : corners) {
            while (hull.size() >= begin + 2 && cross(hull[hull.size() - 2], hull.back(), p) <= 0) hull.pop_back();
            hull.push_back(p);
        }
        if (!hull.empty()) hull.pop_back();
        std::reverse(corners.begin(), corners.end());
    }
    double area = 0;
    for (std::size_t k = 2; k < hull.size(); ++k) area += 0.5 * cross(hull[0], hull[k - 1], hull[k]);
    return area;
}

namespace {

/// y at x of a curve given by points of rising x: cubic Hermite with slopes limited to stay monotone (Fritsch and
/// Carlson 1980); beyond the ends, straight on.
template <class X, class Y>
double interpolate(std::size_t count, X x, Y y, double at) {
    if (count == 0) return 0;
    if (count == 1) return y(0);
    std::size_t k = 1;
    while (k + 1 < count && x(k) < at) ++k;
    auto secant = [&](std::size_t i) { return (y(i + 1) - y(i)) / std::max(1e-300, x(i + 1) - x(i)); };
    auto slope = [&](std::size_t i) {
        if (i == 0) return secant(0);
        if (i + 1 == count) return secant(i - 1);
        const double a = secant(i - 1), b = secant(i);
        return a * b <= 0 ? 0 : 2 * a * b / (a + b);
    };
    const double h = x(k) - x(k - 1), t = (at - x(k - 1)) / std::max(1e-300, h);
    if (t < 0) return y(k - 1) + slope(k - 1) * (at - x(k - 1));
    if (t > 1) return y(k) + slope(k) * (at - x(k));
    const double u = 1 - t;
    return u * u * (1 + 2 * t) * y(k - 1) + u * u * t * h * slope(k - 1) + t * t * (1 + 2 * u) * y(k) -
           t * t * u * h * slope(k);
}

}  // namespace

double displacement_at_force(const IndentationCurve& c, double force) {
    return field_at_force(c, force, &IndentationPoint::displacement);
}

double field_at_displacement(const IndentationCurve& c, double displacement, double IndentationPoint::*field) {
    return interpolate(
        c.points.size(), [&](std::size_t i) { return c.points[i].displacement; },
        [&](std::size_t i) { return c.points[i].*field; }, displacement);
}

double field_at_force(const IndentationCurve& c, double force, double IndentationPoint::*field) {
    return interpolate(
        c.points.size(), [&](std::size_t i) { return c.points[i].force; },
        [&](std::size_t i) { return c.points[i].*field; }, force);
}

FingertipFigures fingertip_figures(const Indentation& finger, const IndentationCurve& c, double friction,
                                   Threads& threads) {
    FingertipFigures f;
    const double nothing = std::nan(""), reached = c.points.back().force;
    auto at = [&](double force, double IndentationPoint::*field) {
        return force <= reached ? field_at_force(c, force, field) : nothing;
    };
    f.displacement_1N = at(1, &IndentationPoint::displacement);
    f.displacement_4N = at(4, &IndentationPoint::displacement);
    f.stiffening = 8 * at(0.5, &IndentationPoint::displacement) / f.displacement_4N;
    f.area_1N = at(1, &IndentationPoint::area);
    f.area_5N = at(5, &IndentationPoint::area);
    f.area_exponent = std::log(f.area_5N / at(0.2, &IndentationPoint::area)) / std::log(25.0);
    f.strain_5N = at(5, &IndentationPoint::surface_strain);
    f.sheared_strain_5N = f.tangential_stiffness_1N = nothing;
    IndentationSettings with_friction{.friction = friction};
    Indentation press = finger;
    const IndentationCurve sticky = indent({press}, {.force_limit = 5.5, .friction = friction}, threads)[0];
    for (const double force : {1.0, 5.0}) {
        if (sticky.points.back().force < force) continue;
        press.depth = displacement_at_force(sticky, force);
        with_friction.shear = force < 2 ? 2e-4 : 4e-3;
        with_friction.shear_steps = force < 2 ? 2 : 40;
        const auto shear = indent({press}, with_friction, threads)[0].shear;
        if (force < 2) {
            f.tangential_stiffness_1N =
                (shear.back().force - shear.front().force) / (shear.back().shift - shear.front().shift);
        } else {
            f.sheared_strain_5N = 0;
            for (const ShearPoint& p : shear) f.sheared_strain_5N = std::max(f.sheared_strain_5N, p.surface_strain);
        }
    }
    return f;
}

}  // namespace palpate
