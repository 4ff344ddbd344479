// Extremes of matter: slivers, neighbours that differ by orders of magnitude, friction of nothing and of ten.

#include <Eigen/Dense>
#include <cmath>

#include "meshes/mesh_quality.h"
#include "scenes/studies/stress/cases.h"

namespace palpate::stress {

namespace {

Eigen::Vector3d node(const TetMesh& mesh, int i) { return Eigen::Vector3d(mesh.nodes[std::size_t(i)].data()); }

double volume(const TetMesh& mesh, const std::array<int, 4>& t) {
    const Eigen::Vector3d a = node(mesh, t[0]);
    return (node(mesh, t[1]) - a).cross(node(mesh, t[2]) - a).dot(node(mesh, t[3]) - a) / 6;
}

double mean_volume(const TetMesh& mesh) {
    double sum = 0;
    for (const auto& t : mesh.tets) sum += volume(mesh, t);
    return sum / double(mesh.tets.size());
}

/// Flattens element `e` to a volume, by moving one of its nodes that neither bone nor pad has towards the face across
/// from it. False where that would turn another element inside out.
bool flatten(TetMesh& mesh, std::size_t e, double wanted) {
    const auto& t = mesh.tets[e];
    for (int k = 0; k < 4; ++k) {
        const int apex = t[std::size_t(k)];
        if (std::binary_search(mesh.bone_nodes.begin(), mesh.bone_nodes.end(), apex) ||
            std::binary_search(mesh.pad_nodes.begin(), mesh.pad_nodes.end(), apex))
            continue;
        const Eigen::Vector3d a = node(mesh, t[std::size_t((k + 1) % 4)]), b = node(mesh, t[std::size_t((k + 2) % 4)]),
                              c = node(mesh, t[std::size_t((k + 3) % 4)]), x = node(mesh, apex);
        const Eigen::Vector3d n = (b - a).cross(c - a);
        const double height = 6 * wanted / n.norm(), now = (x - a).dot(n.normalized());
        const Eigen::Vector3d moved = x - (now - std::copysign(height, now)) * n.normalized();
        const Point before = mesh.nodes[std::size_t(apex)];
        mesh.nodes[std::size_t(apex)] = {moved.x(), moved.y(), moved.z()};
        bool sound = true;
        for (const auto& other : mesh.tets)
            if (std::find(other.begin(), other.end(), apex) != other.end()) sound &= volume(mesh, other) > 0;
        if (sound) return true;
        mesh.nodes[std::size_t(apex)] = before;
    }
    return false;
}

struct Pressed {
    bool sound = true;
    int converged = 0;
    double force = 0, imbalance = 0;  ///< [N]; coupling's against the contact's at the end, as a share
};

/// A press of a millimetre in 30 steps, held for as many.
Pressed press(const SceneSpec& spec) {
    World world = build_world(spec);
    Threads threads(1);
    Pose<double> target = spec.fingers[0].start;
    Pressed p;
    for (int k = 0; k < 60; ++k) {
        if (k < 30) target.position.z -= 1.5e-3 / 30;
        aim(world, 0, target);
        step(world, threads);
        const SkinStatus& s = skin_status(world, world.skins.owner(0));
        p.sound = p.sound && finite(world) && !s.reset;
        p.converged += s.converged;
    }
    p.force = world.contact_surfaces[0].normal_force;
    p.imbalance = std::abs(world.couplings[0].force_N - p.force) / std::max(1e-9, p.force);
    return p;
}

}  // namespace

/// S3
StressOutcome slivers(int effort, const std::atomic<bool>& stop) {
    int tried = 0, refused = 0, stepped = 0, lost = 0, converged = 0, steps = 0;
    double flattest = 1;
    for (int elements : {150, 347})
        for (double share : {1e-3, 1e-6, 1e-9, 1e-12, 1e-15}) {
            SceneSpec spec = press_spec(elements);
            const TetMesh whole = spec.fingers[0].mesh;
            const double mean = mean_volume(whole);
            int found = 0;
            for (std::size_t e = 0; e < whole.tets.size() && found < (effort >= 10 ? 10 : 2) && !stop; ++e) {
                TetMesh mesh = whole;
                if (!flatten(mesh, e, share * mean)) continue;
                ++found, ++tried;
                const auto complaints = check_tets(mesh);
                if (!complaints.empty()) {
                    refused += complaints[0].find(std::to_string(e)) != std::string::npos;
                    continue;
                }
                flattest = std::min(flattest, share);
                spec.fingers[0].mesh = mesh;
                const Pressed p = press(spec);
                lost += !p.sound;
                stepped += p.sound;
                converged += p.converged, steps += 60;
            }
        }
    return {tried > 0 && lost == 0 && refused + stepped == tried,
            text("%d meshes: %d refused by the number of the element, %d simulated (volumes down to %.0e of the mean, "
                 "%.1f %% of the steps converged), %d not finite or reset",
                 tried, refused, stepped, flattest, steps ? 100.0 * converged / steps : 0, lost)};
}

/// S5
StressOutcome unlike_neighbours(int, const std::atomic<bool>&) {
    std::string found;
    bool good = true;
    // Stiffness: every other element of the finger.
    for (double ratio : {1e3, 1e6, 1e9}) {
        SceneSpec spec = press_spec(347);
        FingerSpec& f = spec.fingers[0];
        for (std::size_t e = 0; e < f.mesh.tets.size(); ++e)
            f.element_young.push_back(e % 2 ? std::sqrt(1e9 * ratio) : std::sqrt(1e9 / ratio));
        const Pressed p = press(spec);
        good = good && p.sound && p.converged == 60 && p.imbalance < 1e-4;
        found += text("%sstiffness 1:%.0e: %d of 60 steps converged, %.3g N, forces balance to %.0e",
                      found.empty() ? "" : "; ", ratio, p.converged, p.force, p.imbalance);
    }
    // Mass: a cube under a cube.
    for (double ratio : {1e3, 1e6}) {
        SceneSpec spec;
        spec.objects.push_back({"table", {}, Pose<double>::identity(), 0.5});
        const Shape cube{ShapeKind::box, {0.01, 0.01, 0.01}};
        const double light = 1e-3, heavy = ratio * light;
        for (int i = 0; i < 2; ++i) {
            ObjectSpec o{i ? "heavy" : "light", cube, {{0, 0, 0.01 + 0.02 * i}, {1, 0, 0, 0}}, 0.5};
            o.body = solid_body(cube, i ? heavy : light);
            spec.objects.push_back(o);
        }
        World world = build_world(spec);
        Threads threads(1);
        int unconverged = 0;
        bool reset = false;
        for (int k = 0; k < 400; ++k) {
            step(world, threads);
            unconverged += !world.bodies[0].converged || !world.bodies[1].converged;
            for (const RigidBody& b : world.bodies) reset = reset || b.reset;
        }
        double worst = 0, moved = 0;
        for (std::size_t i = 0; i < 2; ++i) {
            const RigidBody& b = world.bodies[i];
            worst = std::max(worst, std::abs(b.contact_force.z / (b.mass * 9.81) - 1));
            moved = std::max(moved, norm(world.shapes[i + 1].pose.position - spec.objects[i + 1].pose.position));
        }
        good = good && !reset && unconverged == 0 && worst < 1e-3 && moved < 1e-4;
        found += text("; mass 1:%.0e: %d of 400 steps converged, forces balance to %.0e of each weight, moved %.1g mm",
                      ratio, 400 - unconverged, worst, 1e3 * moved);
    }
    return {good, found};
}

/// S9
StressOutcome friction_ends(int effort, const std::atomic<bool>&) {
    // A plate on a slope of 0.99 and 1.01 times the steepest on which it stays.
    constexpr double g = 9.81;
    const Shape plate{ShapeKind::box, {0.02, 0.02, 0.0005}};  // which tips over on no slope here
    double creep = 0, off_law = 0;
    bool right = true;
    const double seconds = effort >= 10 ? 5 : 1;
    for (double dt : {0.001, 0.005})
        for (double friction : {0.0, 0.01, 0.3, 1.0, 10.0})
            for (double share : {0.99, 1.01, 1.5}) {
                const double angle = friction > 0 ? std::min(1.55, share * std::atan(friction)) : 0.1;
                SceneSpec spec;
                spec.solver.dt = dt;
                spec.gravity = {g * std::sin(angle), 0, -g * std::cos(angle)};
                spec.objects.push_back({"slope", {}, Pose<double>::identity(), friction});
                ObjectSpec o{"plate", plate, {{0, 0, 0.0005}, {1, 0, 0, 0}}, friction};
                o.body = solid_body(plate, 0.05);
                spec.objects.push_back(o);
                World world = build_world(spec);
                Threads threads(1);
                const bool sticks = std::tan(angle) < friction;
                const double end = sticks ? seconds : 0.3;
                double earlier = 0;
                while (world.time < end - 1e-9) {
                    if (world.time < 0.1) earlier = world.bodies[0].velocity.x;
                    step(world, threads);
                }
                const double travelled = std::abs(world.shapes[1].pose.position.x);
                if (sticks) {
                    creep = std::max(creep, travelled / end);
                    continue;
                }
                const double a = g * (std::sin(angle) - friction * std::cos(angle));
                const double measured = (world.bodies[0].velocity.x - earlier) / (end - 0.1);
                right = right && travelled > 0;
                if (share > 1.2 || friction == 0) off_law = std::max(off_law, std::abs(measured / a - 1));
            }
    // A finger dragged over a table with no friction, and one with a friction of 10 held aside.
    double drag = 0, slid = 0;
    for (double friction : {0.0, 10.0}) {
        SceneSpec spec = press_spec(347);
        spec.objects[0].friction = friction;
        World world = build_world(spec);
        Threads threads(1);
        Pose<double> target = spec.fingers[0].start;
        double slip_before = 0;
        for (int k = 0; k < 300; ++k) {
            if (k < 30) target.position.z -= 5e-5;
            if (k >= 30 && k < 80) target.position.x += 4e-5;
            aim(world, 0, target);
            step(world, threads);
            const ContactSurface& c = world.contact_surfaces[0];
            if (friction == 0) drag = std::max(drag, std::hypot(c.total.x, c.total.y) / std::max(1e-3, c.normal_force));
            if (k == 150) slip_before = bone_pose(world, world.skins.owner(0)).position.x;
        }
        if (friction > 0)
            slid = std::abs(bone_pose(world, world.skins.owner(0)).position.x - slip_before) / (149 * world.solver.dt);
    }
    return {
        right && creep < 1e-6 && off_law < 0.03 && drag < 1e-9 && slid < 1e-6,
        text("slopes at 0.99 of the limit: creep %.1g um/s at most; at 1.5: acceleration within %.1f %% of Coulomb's; "
             "finger without friction: drag %.0e of its force; with 10, held aside: creeps %.1g um/s",
             1e6 * creep, 100 * off_law, drag, 1e6 * slid)};
}

}  // namespace palpate::stress
