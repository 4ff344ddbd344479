#include "scenes/compare.h"

#include <cmath>

namespace palpate {

namespace {

constexpr double platform_thickness = 0.004;  // [m], far more than any penetration

/// The platform as a cylinder whose face is the disk, in the finger frame.
Pose<double> platform_pose(const DeviceModel& model, const Coordinates& w) {
    const Platform p = model.kind->platform(model, w);
    const Eigen::Vector3d normal = model.mount.linear() * p.normal;
    const Eigen::Vector3d centre = model.mount * p.centre - 0.5 * platform_thickness * normal;
    const Eigen::Quaterniond q = Eigen::Quaterniond::FromTwoVectors(Eigen::Vector3d::UnitZ(), normal);
    return {{centre.x(), centre.y(), centre.z()}, {q.w(), q.x(), q.y(), q.z()}};
}

/// Roll of the finger about its own axis against the horizon [degrees].
double roll_deg(const Pose<double>& bone) {
    const Mat3<double> R = rotation_matrix(bone.rotation);
    return 57.29577951308232 * std::atan2(R[2][1], R[2][2]);
}

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
    platform.shape = {ShapeKind::cylinder, {model.disk_radius, 0.5 * platform_thickness, 0}};
    platform.pose = platform_pose(model, model.rest);
    spec.objects.push_back(platform);
    PadOnPlatform pad{build_world(spec), {}};
    pad.finger = pad.world.skins.owner(0);
    return pad;
}

std::vector<Vec3<double>> resimulate(PadOnPlatform& pad, const DeviceModel& model, const Coordinates& w,
                                     oneapi::tbb::task_arena& arena, bool& converged) {
    pad.world.shapes[0].pose = platform_pose(model, w);
    for (int i = 0; i < 3; ++i) {
        step(pad.world, arena);
        const SkinStatus& status = skin_status(pad.world, pad.finger);
        converged = status.converged;
        if (status.converged && status.newton_iterations <= 1) break;
    }
    const Mat3<double> R = rotation_matrix(bone_pose(pad.world, pad.finger).rotation);
    std::vector<Vec3<double>> forces;
    for (const Vec3<double>& f : pad.world.contact_surfaces[0].force) forces.push_back(transposed_times(R, f));
    return forces;
}

std::vector<std::vector<ComparedStep>> compare(Simulation& s, const std::atomic<bool>& stop,
                                               const std::function<void(double)>& progress) {
    const std::size_t thimbles = s.world.matchings.size();
    std::vector<std::vector<ComparedStep>> all(thimbles);
    std::vector<std::vector<PadOnPlatform>> pads(thimbles);
    std::vector<std::array<Coordinates, 3>> last(thimbles);
    for (std::size_t t = 0; t < thimbles; ++t)
        for (int m = 0; m < 3; ++m) {
            pads[t].push_back(make_pad_on_platform(s.scene.spec.fingers[s.scene.spec.thimbles[t].finger],
                                                   s.world.matchings[t].model));
            last[t][m] = s.world.matchings[t].model.rest;
        }
    const auto steps = std::int64_t(std::llround(s.scene.duration / s.world.solver.dt));
    for (std::int64_t k = 0; k < steps && !stop; ++k) {
        advance(s);
        if (progress) progress(double(k + 1) / double(steps));
        for (std::size_t t = 0; t < thimbles; ++t) {
            const Matching& matching = s.world.matchings[t];
            if (!matching.fresh) continue;
            const ContactSurface& contact = *s.world.contact_surfaces.find(matching.finger);
            const Pose<double> bone = bone_pose(s.world, matching.finger);
            const Mat3<double> R = rotation_matrix(bone.rotation);
            ComparedStep row;
            row.time = s.world.time;
            row.roll_deg = roll_deg(bone);
            for (const Vec3<double>& f : contact.force) row.virtual_force_N += norm(f);
            if (contact.touching == 0) continue;
            for (int m = 0; m < 3; ++m) {
                row.result[m] =
                    match(MatchingMethod(m), matching.model, matching.points, matching.settings, last[t][m]);
                last[t][m] = row.result[m].w;
                const auto forces = resimulate(pads[t][m], matching.model, row.result[m].w, *s.arena, row.converged[m]);
                for (std::size_t i = 0; i < forces.size(); ++i)
                    row.error_N[m] += norm(forces[i] - transposed_times(R, contact.force[i]));
            }
            all[t].push_back(row);
        }
    }
    return all;
}

}  // namespace palpate
