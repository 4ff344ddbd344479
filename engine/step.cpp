#include "engine/step.h"

#include <chrono>

#include "engine/systems.h"

namespace palpate {

namespace {

template <class System>
void timed(double& seconds, System system) {
    const auto start = std::chrono::steady_clock::now();
    system();
    seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

}  // namespace

void step(World& w, oneapi::tbb::task_arena& arena) {
    w.time += w.solver.dt;
    ++w.step;
    timed(w.profile.read_trackers, [&] { read_trackers(w.tracker_poses, w.pose_filters); });
    timed(w.profile.couple,
          [&] { couple(w.tracker_poses, w.solver, w.skins, w.couplings, w.double_chunks, w.float_chunks); });
    timed(w.profile.detect_contacts, [&] {
        begin_bodies(w.solver, w.time, w.shapes, w.bodies);
        w.crowded += detect_contacts(w.shapes, w.bodies, w.solver, w.double_chunks, w.float_chunks);
        gather_lanes(w.solver, w.step, w.skins, w.double_chunks, w.float_chunks);
    });
    timed(w.profile.solve_skin, [&] { solve_skins(w.solver, arena, w.double_chunks, w.float_chunks); });
    timed(w.profile.solve_bodies, [&] {
        solve_bodies(w.solver, w.gravity, w.pair_frictions, arena, w.shapes, w.bodies, w.body_solve, w.double_chunks,
                     w.float_chunks);
    });
    timed(w.profile.extract_contact,
          [&] { extract_contact(w.skins, w.double_chunks, w.float_chunks, w.couplings, w.contact_surfaces); });
    timed(w.profile.match_devices,
          [&] { match_devices(w.contact_surfaces, w.time, arena, w.matchings, w.force_matchers); });
    timed(w.profile.publish, [&] { publish(w.matchings, w.time, w.sampled_at, w.device_links); });
    for (RigidShape& shape : w.shapes) shape.previous = shape.pose;
}

}  // namespace palpate
