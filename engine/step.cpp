#include "engine/step.h"

#include <algorithm>
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

/// Fingers for themselves, and bodies with the fingers that are near them: the one beside the other where both are to
/// be solved and there are threads for it. What bodies take beyond the time of the fingers is then theirs.
/// Returns how much of solve_skin read contact [s].
double solve(World& w, Threads& threads) {
    StepProfile& p = w.profile;
    double read = 0;
    lend_threads(threads, w.chunks);
    auto skins = [&] {
        timed(p.solve_skin,
              [&] { read = solve_skins(w.solver, w.skins, threads, w.chunks, w.couplings, w.contact_surfaces); });
        p.solve_skin -= read;
    };
    auto bodies = [&] {
        solve_bodies(w.solver, w.gravity, w.pair_frictions, w.time, w.skins, threads, w.shapes, w.bodies,
                     w.finger_pairs, w.soft, w.body_solve, w.chunks);
    };
    if (threads.count() == 1 || !solved_apart(w.chunks)) {
        skins();
        timed(p.solve_bodies, bodies);
        return read;
    }
    // The caller begins at once with what took longer in the last step (solve_bodies: what bodies took beyond the
    // fingers' time), while another thread is woken for the other. It makes no difference to either.
    const bool bodies_first = p.solve_bodies > 0.25 * p.solve_skin;
    timed(p.solve_bodies, [&] { threads.for_each(2, [&](int k) { (k == 0) == bodies_first ? bodies() : skins(); }); });
    p.solve_bodies = std::max(0.0, p.solve_bodies - p.solve_skin);
    return read;
}

}  // namespace

void step(World& w, Threads& threads) {
    w.time += w.solver.dt;
    ++w.step;
    StepProfile& p = w.profile;
    begin_cuts(std::chrono::steady_clock::now(), p.extract_contact + p.match_devices + p.publish + p.end_objects,
               w.deadline, w.chunks, w.body_solve);
    timed(p.read_trackers, [&] { read_trackers(w.solver.dt, w.tracker_poses, w.pose_filters); });
    timed(p.couple, [&] {
        couple(w.tracker_poses, w.solver, w.skins, w.couplings, w.chunks);
        hold_soft_objects(w.shapes, w.solver, w.soft, w.chunks);
    });
    timed(p.begin_bodies, [&] { begin_bodies(w.solver, w.time, w.shapes, w.bodies); });
    timed(p.detect_contacts, [&] {
        w.contact_growths += detect_contacts(w.shapes, w.bodies, w.solver, threads, w.chunks);
        w.contact_growths +=
            detect_finger_pairs(w.shapes, w.bodies, w.skins, w.solver, w.body_solve, w.finger_pairs, w.chunks);
        detect_soft_contacts(w.shapes, w.skins, w.solver, w.soft, w.chunks);
    });
    timed(p.choose_detail, [&] { choose_detail(w.solver, w.step, w.chunks); });
    timed(p.gather_lanes, [&] { gather_lanes(w.skins, w.chunks); });
    const double read = solve(w, threads);
    end_cuts(w.deadline, w.chunks, w.body_solve);
    timed(p.extract_contact, [&] {
        extract_contact(w.skins, w.solver.tolerance, threads, w.finger_pairs, w.soft, w.chunks, w.couplings,
                        w.contact_surfaces);
        find_entered_tissue(w.time, w.soft, w.chunks, w.bodies);
    });
    p.extract_contact += read;
    timed(p.match_devices, [&] { match_devices(w.contact_surfaces, w.time, threads, w.matchings, w.force_matchers); });
    timed(p.publish, [&] {
        publish(w.tracker_poses, w.couplings, w.matchings, w.time, w.solver.dt, w.sampled_at, w.device_links);
    });
    timed(p.end_objects, [&] { end_objects(w.shapes); });
}

}  // namespace palpate
