#include "scenes/run/grasp.h"

#include <algorithm>
#include <cmath>

#include "engine/math/svd3.h"
#include "scenes/run/object_output.h"
#include "scenes/run/wrapped.h"

namespace palpate {

namespace {

const std::vector<std::string> own_columns{"time_s",       "x_mm",        "y_mm",        "z_mm",         "qw",
                                           "qx",           "qy",          "qz",          "v_x_mm_per_s", "v_y_mm_per_s",
                                           "v_z_mm_per_s", "contact_x_N", "contact_y_N", "contact_z_N",  "held",
                                           "balance",      "iterations",  "converged",   "reset"};

const ObjectContact* contact_of(const World& world, EntityId finger, int object) {
    for (const ObjectContact& c : world.contact_surfaces.find(finger)->objects)
        if (c.object == object) return &c;
    return nullptr;
}

/// Row of the object that a body moves.
int object_of(const World& world, int body) {
    for (std::size_t row = 0; row < world.shapes.size(); ++row)
        if (world.shapes[row].body == body || world.shapes[row].held_body == body) return int(row);
    return -1;
}

double friction_of(const SceneSpec& spec, int finger, int object) {
    for (const FingerFriction& own : spec.finger_frictions)
        if (own.finger == finger && own.object == object) return own.friction;
    return spec.objects[std::size_t(object)].friction;
}

}  // namespace

void read_grip(const Simulation& s, std::size_t finger, int object, std::vector<GripSample>& grip) {
    grip.clear();
    const World& w = s.world;
    const VirtualObject& shape = w.shapes[object];
    const Vec3<double> centre = centre_pose(w.bodies[shape.body], shape.pose).position;
    const ContactSurface& c = *w.contact_surfaces.find(s.fingers[finger]);
    const double friction = friction_of(s.scene.spec, int(finger), object);
    for (std::size_t k = 0; k < c.force.size(); ++k) {
        if (!c.touches[k]) continue;
        const Vec3<double> x = transform(c.bone, c.position[k]);
        auto distance = [&](int o) { return surface_point(w.shapes[o].shape, w.shapes[o].pose, x).distance; };
        bool nearest = true;  // a sample between two objects counts to the nearer one
        for (const ObjectContact& other : c.objects)
            if (other.object >= 0 && other.object != object && other.normal_force > 0)
                nearest &= distance(object) <= distance(other.object);
        if (!nearest) continue;
        const Vec3<double> gradient = surface_point(shape.shape, shape.pose, x).normal;
        const Vec3<double> normal = (1 / std::max(norm(gradient), 1e-9)) * gradient;
        const double pressed = dot(c.force[k], normal);
        grip.push_back({x - centre, normal, friction * std::max(0.0, pressed), pressed * normal - c.force[k]});
    }
}

namespace {

/// Where a finger's samples are on a body, and by how much those that touch it have moved over it since the last step,
/// mean by force: to and fro cancels, which a sum of lengths does not.
void follow_slide(const Simulation& s, std::size_t finger, int object, bool held, LastGrip& last) {
    const ContactSurface& c = *s.world.contact_surfaces.find(s.fingers[finger]);
    const VirtualObject& shape = s.world.shapes[object];
    const std::vector<Vec3<double>> before = std::move(last.before);
    last.before.clear();
    if (!held) {
        last.slid = {0, 0, 0};
        return;
    }
    Vec3<double> sliding{0, 0, 0};
    double weight = 0;
    for (std::size_t k = 0; k < c.force.size(); ++k) {
        const Vec3<double> world = transform(c.bone, c.position[k]), x = inverse_transform(shape.pose, world);
        last.before.push_back(x);
        if (!c.touches[k] || before.empty()) continue;
        const Vec3<double> n = surface_point(shape.shape, shape.pose, world).normal;
        const Vec3<double> normal = transposed_times(rotation_matrix(shape.pose.rotation), (1 / norm(n)) * n);
        const Vec3<double> step = x - before[k];
        const double force = norm(c.force[k]);
        sliding += force * (step - dot(step, normal) * normal);
        weight += force;
    }
    if (weight > 0) last.slid += (1 / weight) * sliding;
}

}  // namespace

std::vector<std::string> body_columns(const Simulation& s) {
    std::vector<std::string> columns = own_columns;
    for (const FingerSpec& f : s.scene.spec.fingers)
        for (const char* what : {"grip_N", "friction_use", "slip_um", "slid_mm"})
            columns.push_back(f.name + "_" + what);
    return columns;
}

void record_bodies(Simulation& s) {
    const World& w = s.world;
    for (int b = 0; b < int(w.bodies.size()); ++b) {
        const RigidBody& body = w.bodies[b];
        const int object = object_of(w, b);
        const VirtualObject& shape = w.shapes[object];
        const Vec3<double>&p = shape.pose.position, &v = body.velocity;
        const Vec3<double> f = object_output(w, std::size_t(object)).force;
        const Quaternion<double>& q = shape.pose.rotation;
        const double weight = std::max(body.mass * norm(w.gravity), 1e-9);
        Vec3<double> by_fingers{0, 0, 0};
        double grip = 0;
        bool settled = true;
        for (const EntityId finger : s.fingers)
            if (const ObjectContact* c = contact_of(w, finger, object)) {
                by_fingers -= c->force, grip += c->normal_force;
                settled &= !w.contact_surfaces.find(finger)->rough;
            }
        // Held: by fingers and by nothing else, such as what keeps it where it is until its release.
        const bool held = shape.body >= 0 && grip > 0 && norm(f - by_fingers) < 1e-2 * weight + 1e-3 * grip;
        const double balance = norm(f + body.mass * (w.gravity - body.acceleration)) / weight;
        std::vector<double>& out = s.body_series[std::size_t(b)].values;
        for (double value :
             {w.time, 1e3 * p.x, 1e3 * p.y, 1e3 * p.z, q.w, q.x, q.y, q.z, 1e3 * v.x, 1e3 * v.y, 1e3 * v.z, f.x, f.y,
              f.z, double(held), balance, double(body.iterations), double(body.converged), double(body.reset)})
            out.push_back(value);
        for (std::size_t i = 0; i < s.fingers.size(); ++i) {
            const ObjectContact* c = contact_of(w, s.fingers[i], object);
            out.push_back(c ? c->normal_force : 0);
            out.push_back(c && c->friction_available > 0 ? c->friction_force / c->friction_available : 0);
            out.push_back(c ? 1e6 * c->slip : 0);
            LastGrip& last = s.last_grips[std::size_t(b) * s.fingers.size() + i];
            follow_slide(s, i, object, held && c && c->normal_force > 0, last);
            out.push_back(1e3 * norm(last.slid));
            if (!held) continue;
            last.unsettled += !settled;
            if (!settled) continue;
            last.grip_sum += c ? c->normal_force : 0;
            ++last.steps;
            last.touching += c && c->normal_force > 0;
            if (c && c->friction_available > 0)
                last.friction_use = std::max(last.friction_use, c->friction_force / c->friction_available);
            if (c && c->normal_force > 0.5 * last.grip_sum / double(last.steps)) read_grip(s, i, object, last.samples);
        }
    }
}

double grasp_capacity(const std::vector<GripSample>& all, double mass, const Vec3<double>& gravity) {
    if (all.empty() || !(mass * norm(gravity) > 0)) return 0;
    Motion weight = Motion::Zero();
    weight.head<3>() << -mass * gravity.x, -mass * gravity.y, -mass * gravity.z;
    // Between two flat faces friction resists nothing along their normal, and need not.
    constexpr double flat = 0.95;
    Mat3<double> along_normals = Mat3<double>::zero();
    double total = 0;
    for (const GripSample& s : all) {
        along_normals = along_normals + s.friction_limit * outer(s.normal, s.normal);
        total += s.friction_limit;
    }
    const SignedSvd<double> svd = signed_svd(along_normals);
    const int first = svd.sigma.x > flat * total ? 1 : 0;
    WrenchBasis kept = WrenchBasis::Zero(6, 6 - first);
    for (int k = first; k < 3; ++k)
        for (int d = 0; d < 3; ++d) kept(d, k - first) = svd.V[d][k];
    kept.bottomRightCorner<3, 3>().setIdentity();
    return 1 + wrench_reserve(all, weight, kept);
}

namespace {

/// Whether a step of static equilibrium has found none for a body: a hundredth of its weight or more is borne by
/// nothing.
bool lacks_equilibrium(const Simulation& s, int body, double time, double balance) {
    const RigidBody& b = s.world.bodies[std::size_t(body)];
    return !s.world.solver.inertia && norm(s.world.gravity) > 0 && time > b.release + 1e-9 && !(balance < 0.01);
}

}  // namespace

std::vector<BodySummary> summarise_bodies(const Simulation& s) {
    std::vector<BodySummary> all;
    for (int b = 0; b < int(s.world.bodies.size()); ++b) {
        const Series& series = s.body_series[std::size_t(b)];
        const VirtualObject& shape = s.world.shapes[object_of(s.world, b)];
        BodySummary out;
        out.name = shape.name;
        const auto held = series.column("held"), converged = series.column("converged"), reset = series.column("reset");
        const auto time = series.column("time_s"), balance = series.column("balance");
        std::vector<double> balances;
        std::size_t last = 0, count = 0;
        for (std::size_t k = 0; k < held.size(); ++k) {
            out.converged_share += converged[k] / double(held.size());
            out.resets += int(reset[k]);
            if (held[k] > 0) last = k, ++count, balances.push_back(balance[k]);
            if (lacks_equilibrium(s, b, time[k], balance[k]))
                ++out.unbalanced_steps, out.worst_balance = std::max(out.worst_balance, balance[k]);
        }
        out.held_s = double(count) * s.world.solver.dt;
        if (count == 0) {
            all.push_back(out);
            continue;
        }
        std::nth_element(balances.begin(), balances.begin() + long(balances.size() / 2), balances.end());
        out.balance = balances[balances.size() / 2];
        for (std::size_t k = last - std::min(last, count / 4); k <= last; ++k) {
            double distance = 0;
            for (std::size_t d = 1; d <= 3; ++d) distance = std::hypot(distance, series.at(k, d) - series.at(last, d));
            out.drift_mm = std::max(out.drift_mm, distance);
        }
        bool lost = last + 1 < held.size() && time[last] + 0.02 < time.back();
        for (std::size_t i = 0; i < s.fingers.size(); ++i) {
            const std::size_t column = own_columns.size() + 4 * i;
            GripSummary g;
            g.finger = s.scene.spec.fingers[i].name;
            for (std::size_t k = 0; k < held.size(); ++k)
                if (held[k] > 0 && series.at(k, column) > 0) g.slip_mm = std::max(g.slip_mm, series.at(k, column + 3));
            const LastGrip& grip = s.last_grips[std::size_t(b) * s.fingers.size() + i];
            out.unsettled_steps = std::max(out.unsettled_steps, grip.unsettled);
            if (last + 1 < held.size() && series.at(last + 1, column) > 0) lost = false;  // put down, not dropped
            if (grip.touching == 0) continue;
            g.mean_N = grip.grip_sum / double(grip.touching), g.friction_use = grip.friction_use;
            g.reserve = grip_reserve(grip.samples, -1.0 * s.world.gravity);
            out.slip_mm = std::max(out.slip_mm, g.slip_mm);
            out.grips.push_back(g);
        }
        if (lost) out.dropped_at_s = time[last];
        std::vector<GripSample> all_grips;
        for (std::size_t i = 0; i < s.fingers.size(); ++i)
            for (const GripSample& g : s.last_grips[std::size_t(b) * s.fingers.size() + i].samples)
                all_grips.push_back(g);
        out.slips_at_weights = grasp_capacity(all_grips, s.world.bodies[std::size_t(b)].mass, s.world.gravity);
        all.push_back(out);
    }
    return all;
}

std::string to_text(const std::vector<BodySummary>& bodies) {
    std::string out;
    for (const BodySummary& b : bodies) {
        const char* name = b.name.c_str();
        if (b.held_s <= 0) {
            const std::string steps =
                b.converged_share < 1 ? written("; %.1f %% of its steps converged", 100 * b.converged_share) : "";
            out += wrapped(written("%s was never held by fingers alone", name) + steps);
        } else {
            out +=
                "\n" + wrapped(written("%s was held for %.2f s: slip %.3f mm, drift in the last quarter %.4f mm, force "
                                       "balance %.1e of its weight, %.1f %% of steps converged",
                                       name, b.held_s, b.slip_mm, b.drift_mm, b.balance, 100 * b.converged_share));
            out += written("  %-12s %8s %9s %8s %9s %9s %9s\n", "", "grip", "friction", "slip", "weakest", "weight",
                           "twist");
            out += written("  %-12s %8s %9s %8s %9s %9s %9s\n", "finger", "N", "used %", "mm", "N", "N", "N mm");
            for (const GripSummary& g : b.grips)
                out += written("  %-12s %8.3f %9.1f %8.3f %9.3f %9.3f %9.3f\n", g.finger.c_str(), g.mean_N,
                               100 * g.friction_use, g.slip_mm, g.reserve.weakest_N, g.reserve.load_N,
                               g.reserve.twist_N_mm);
            if (b.slips_at_weights > 0)
                out += wrapped(
                    written("gripped like this, %s would slip at %.2f times its weight", name, b.slips_at_weights),
                    "  ");
            if (b.unsettled_steps > 0)
                out += wrapped(
                    written("%lld steps of the hold ended too far from balance to be counted: what is said of it may "
                            "be the solve's and not the grasp's; use more iterations (solver.preset) or other steps "
                            "(dt_ms)",
                            (long long)b.unsettled_steps),
                    "  ");
            else if (b.slip_mm > 1)
                out += wrapped(b.name + " slipped through the fingers: grip harder, or give it more friction", "  ");
            if (b.dropped_at_s >= 0) out += written("  %s was dropped at t = %.2f s\n", name, b.dropped_at_s);
        }
        if (b.unbalanced_steps > 0)
            out += wrapped(written("%s was in no static equilibrium in %lld steps: contact forces missed its weight by "
                                   "up to %.3g %% of it. What nothing holds sinks a little in each step, by no law; "
                                   "hold it, use more iterations (solver.preset), or leave out static",
                                   name, (long long)b.unbalanced_steps, 100 * b.worst_balance),
                           "  ");
        if (b.resets)
            out += wrapped(
                written("%s diverged and was stopped %d times: use smaller steps (dt_ms)", name, int(b.resets)), "  ");
    }
    return out;
}

}  // namespace palpate
