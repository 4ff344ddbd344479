#include "scenes/compare.h"

#include <chrono>
#include <cmath>

#include "devices/least_squares.h"

namespace palpate {

namespace {

/// Roll of the finger about its own axis against the horizon [degrees].
double roll_deg(const Pose<double>& bone) {
    const Mat3<double> R = rotation_matrix(bone.rotation);
    return 57.29577951308232 * std::atan2(R[2][1], R[2][2]);
}

/// Forces and touching samples of a contact, finger frame.
struct Felt {
    std::vector<Vec3<double>> force;
    std::vector<char> touches;
};
Felt felt(const ContactSurface& c) {
    const Mat3<double> R = rotation_matrix(c.bone.rotation);
    Felt f{{}, c.touches};
    for (const Vec3<double>& force : c.force) f.force.push_back(transposed_times(R, force));
    return f;
}

RenderingError difference(const Felt& wanted, const Felt& rendered, const ContactSurface& surface) {
    RenderingError e;
    Vec3<double> net{0, 0, 0}, torque{0, 0, 0}, centre[2]{{0, 0, 0}, {0, 0, 0}};
    double weight[2]{0, 0};
    for (std::size_t i = 0; i < wanted.force.size(); ++i) {
        const Vec3<double> d = rendered.force[i] - wanted.force[i];
        e.field_N += norm(d);
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
        if (m.settings.joint_step > 0) {
            model = within_a_step(m.model, row.result.w.size() ? row.result.w : m.model.rest, m.settings.joint_step);
            last = move_inside_limits(model, model.rest, last - model.rest);
        }
        MatchingResult r = match(method, model, m.points, m.settings, last);
        last = r.w;
        if (method == MatchingMethod::force) {
            for (std::size_t i = 0; i < wanted.force.size(); ++i)
                for (int d = 0; d < 3; ++d) forces.wanted[std::ptrdiff_t(3 * i) + d] = wanted.force[i][d];
            r = match_forces(forces, model, m.settings, r);
        }
        row.microseconds = 1e6 * std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
        row.result = r;
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
    ObjectSpec platform;
    platform.name = "platform";
    platform.shape = platform_shape(model);
    platform.pose = platform_pose(model, model.rest);
    spec.objects.push_back(platform);
    PadOnPlatform pad{build_world(spec), {}};
    pad.finger = pad.world.skins.owner(0);
    return pad;
}

bool resimulate(PadOnPlatform& pad, const DeviceModel& model, const Coordinates& w, oneapi::tbb::task_arena& arena) {
    pad.world.shapes[0].pose = platform_pose(model, w);
    bool converged = false;
    for (int i = 0; i < 3; ++i) {
        step(pad.world, arena);
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
            const Felt wanted = felt(contact);
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
            for (const Vec3<double>& f : wanted.force) row.virtual_force_N += norm(f);
            for (Contestant& c : contestants[t]) {
                Coordinates w = c.row.result.w;
                if (c.servo) configuration_of(matching.model, c.servo->driver->actual(s.world.time), w);
                c.row.converged = resimulate(c.pad, matching.model, w, *s.arena);
                c.row.error = difference(wanted, felt(c.pad.world.contact_surfaces[0]), contact);
                row.methods.push_back(c.row);
            }
            all[t].push_back(std::move(row));
        }
    }
    return all;
}

}  // namespace palpate
