#include "scenes/studies/compare.h"

#include <chrono>
#include <cmath>

#include "devices/matching/least_squares.h"

namespace palpate {

namespace {

/// Roll of the finger about its own axis against the horizon [degrees].
double roll_deg(const Pose<double>& bone) {
    const Mat3<double> R = rotation_matrix(bone.rotation);
    return 57.29577951308232 * std::atan2(R[2][1], R[2][2]);
}

/// Forces, normals and touching samples of a contact, finger frame.
struct Felt {
    std::vector<Vec3<double>> force, normal;  ///< normals: of the nearest object that presses; zero where none does
    std::vector<char> touches;
};

/// Outward unit normal, at a place in the world, of the nearest of the objects that press on a finger.
Vec3<double> normal_at(const ContactSurface& c, const Table<VirtualObject>& shapes, const Vec3<double>& x) {
    Vec3<double> normal{0, 0, 0};
    double nearest = 1e300;
    for (const ObjectContact& o : c.objects) {
        if (o.object < 0 || o.normal_force <= 0) continue;
        const VirtualObject& shape = shapes[std::size_t(o.object)];
        const auto surface = surface_point(shape.shape, shape.pose, x);
        if (surface.distance >= nearest) continue;
        nearest = surface.distance;
        normal = (1 / std::max(norm(surface.normal), 1e-9)) * surface.normal;
    }
    return normal;
}

Felt felt(const ContactSurface& c, const Table<VirtualObject>& shapes) {
    const Mat3<double> R = rotation_matrix(c.bone.rotation);
    Felt f{{}, {}, c.touches};
    for (std::size_t i = 0; i < c.force.size(); ++i) {
        f.force.push_back(transposed_times(R, c.force[i]));
        f.normal.push_back(c.touches[i] ? transposed_times(R, normal_at(c, shapes, transform(c.bone, c.position[i])))
                                        : Vec3<double>{0, 0, 0});
    }
    return f;
}

/// What of a force is across a normal.
double shear_of(const Vec3<double>& force, const Vec3<double>& normal) {
    return norm(force - dot(force, normal) * normal);
}

RenderingError difference(const Felt& wanted, const Felt& rendered, const ContactSurface& surface) {
    RenderingError e;
    Vec3<double> net{0, 0, 0}, torque{0, 0, 0}, centre[2]{{0, 0, 0}, {0, 0, 0}};
    double weight[2]{0, 0};
    for (std::size_t i = 0; i < wanted.force.size(); ++i) {
        const Vec3<double> d = rendered.force[i] - wanted.force[i];
        e.field_N += norm(d);
        // Along the wanted normal; where nothing was wanted, along the platform's.
        const Vec3<double>& n = wanted.touches[i] ? wanted.normal[i] : rendered.normal[i];
        e.normal_N += std::abs(dot(d, n));
        e.shear_N += shear_of(d, n);
        net += d;
        torque += cross(surface.position[i], d);
        if (wanted.touches[i] != rendered.touches[i]) e.area_mm2 += 1e6 * surface.area[i];
        for (int k = 0; k < 2; ++k) {
            const double f = norm((k ? rendered : wanted).force[i]);
            weight[k] += f;
            centre[k] += f * surface.position[i];
        }
    }
    e.net_N = norm(net);
    e.torque_Nmm = 1e3 * norm(torque);
    if (weight[0] > 0 && weight[1] > 0)
        e.centroid_mm = 1e3 * norm(1 / weight[0] * centre[0] - 1 / weight[1] * centre[1]);
    return e;
}

/// One method on one thimble, with what it keeps from step to step.
struct Contestant {
    MatchingMethod method;
    PadOnPlatform pad;
    ForceMatcher forces;
    std::unique_ptr<ThimbleLoop> servo;
    Coordinates last;

    Contestant(MatchingMethod m, const Simulation& s, std::size_t t, bool through_servo)
        : method(m),
          pad(make_pad_on_platform(s.scene.spec.fingers[std::size_t(s.scene.spec.thimbles[t].finger)],
                                   s.world.matchings[t].model)),
          last(s.world.matchings[t].model.rest) {
        const ThimbleSpec& spec = s.scene.spec.thimbles[t];
        if (m == MatchingMethod::force)
            forces = build_force_matcher(s.scene.spec.fingers[std::size_t(spec.finger)], spec.model, spec.settings);
        if (!through_servo) return;
        servo = std::make_unique<ThimbleLoop>();
        initialise(*servo, spec.model, s.scene.loop,
                   make_simulated_driver(s.scene.servo, spec.model.kind->joints(spec.model, spec.model.rest).q));
    }

    void render(const Matching& m, const Felt& wanted) {
        const auto start = std::chrono::steady_clock::now();
        DeviceModel model = m.model;
        if (m.settings.joint_speed > 0) {
            model = within_a_step(m.model, row.result.w.size() ? row.result.w : m.model.rest,
                                  m.settings.joint_speed * m.since_last);
            last = move_inside_limits(model, model.rest, last - model.rest);
        }
        const Coordinates from = last;
        MatchingResult r = match(method, model, m.points, m.settings, from);
        const double matched = r.residual;
        last = r.w;
        if (method == MatchingMethod::force) {
            for (std::size_t i = 0; i < wanted.force.size(); ++i)
                for (int d = 0; d < 3; ++d)
                    forces.wanted[std::ptrdiff_t(3 * i) + d] =
                        wanted.touches[i] && !m.points[i].touches ? 0 : wanted.force[i][d];
            r = match_forces(forces, model, m.points, m.settings, from, r);
        }
        row.microseconds = 1e6 * std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
        r.constraint_active = at_a_limit(m.model, r.q);
        row.result = r;
        row.by_least_squares = by_least_squares(model, m, from, matched);
    }
    /// Whether SLSQP alone would have stayed above what was found.
    bool by_least_squares(const DeviceModel& model, const Matching& m, const Coordinates& start, double found) const {
        if (method == MatchingMethod::unconstrained || method == MatchingMethod::plane) return false;
        if (m.settings.solver != MatchingSolver::slsqp) return true;
        MatchingSettings alone = m.settings;
        alone.sideways_starts = 0;
        return found < match_constrained(model, m.points, alone, start).residual;
    }
    ComparedStep::Method row;
};

}  // namespace

PadOnPlatform make_pad_on_platform(const FingerSpec& finger, const DeviceModel& model) {
    SceneSpec spec;
    spec.solver.inertia = false;
    spec.solver.newton_iterations = 200;
    spec.fingers.push_back(finger);
    FingerSpec& f = spec.fingers.back();
    f.single_precision = false;
    f.start = Pose<double>::identity();
    f.coupling = Coupling{};
    f.coupling.stiffness = 1e6;  // fixed at the nail
    f.coupling.angular_stiffness = 1e3;
    f.coupling.max_force = 1e5;
    f.coupling.max_torque = 1e4;
    ObjectSpec platform;
    platform.name = "platform";
    platform.shape = platform_shape(model);
    platform.pose = platform_pose(model, model.rest);
    spec.objects.push_back(platform);
    PadOnPlatform pad{build_world(spec), {}};
    pad.finger = pad.world.skins.owner(0);
    return pad;
}

bool resimulate(PadOnPlatform& pad, const DeviceModel& model, const Coordinates& w, Threads& threads) {
    pad.world.shapes[0].pose = platform_pose(model, w);
    bool converged = false;
    for (int i = 0; i < 3; ++i) {
        step(pad.world, threads);
        const SkinStatus& status = skin_status(pad.world, pad.finger);
        converged = status.converged;
        if (status.converged && status.newton_iterations <= 1) break;
    }
    return converged;
}

std::vector<std::vector<ComparedStep>> compare(Simulation& s, const CompareOptions& options,
                                               const std::atomic<bool>& stop,
                                               const std::function<void(double)>& progress) {
    const std::size_t thimbles = s.world.matchings.size();
    std::vector<std::vector<ComparedStep>> all(thimbles);
    std::vector<std::vector<Contestant>> contestants(thimbles);
    for (std::size_t t = 0; t < thimbles; ++t)
        for (const MatchingMethod method : options.methods)
            contestants[t].emplace_back(method, s, t, options.through_servo);
    const auto steps = std::int64_t(std::llround(s.scene.duration / s.world.solver.dt));
    for (std::int64_t k = 0; k < steps && !stop; ++k) {
        advance(s);
        if (progress) progress(double(k + 1) / double(steps));
        for (std::size_t t = 0; t < thimbles; ++t) {
            const Matching& matching = s.world.matchings[t];
            const ContactSurface& contact = *s.world.contact_surfaces.find(matching.finger);
            const Felt wanted = felt(contact, s.world.shapes);
            for (Contestant& c : contestants[t]) {
                if (matching.fresh) c.render(matching, wanted);
                if (!c.servo) continue;
                if (matching.fresh) c.servo->mailbox.publish({s.world.time, c.row.result.q, true, 0, {}});
                tick(*c.servo, s.world.time);
            }
            if (!matching.fresh || contact.touching == 0) continue;
            ComparedStep row;
            row.time = s.world.time;
            row.roll_deg = roll_deg(contact.bone);
            for (std::size_t i = 0; i < wanted.force.size(); ++i) {
                row.virtual_force_N += norm(wanted.force[i]);
                row.virtual_shear_N += shear_of(wanted.force[i], wanted.normal[i]);
            }
            for (Contestant& c : contestants[t]) {
                Coordinates w = c.row.result.w;
                if (c.servo) configuration_of(matching.model, c.servo->driver->actual(s.world.time), w);
                c.row.converged = resimulate(c.pad, matching.model, w, *s.threads);
                c.row.error = difference(wanted, felt(c.pad.world.contact_surfaces[0], c.pad.world.shapes), contact);
                row.methods.push_back(c.row);
            }
            all[t].push_back(std::move(row));
        }
    }
    return all;
}

}  // namespace palpate
