
#include <numeric>

#include "devices/matching/least_squares.h"
#include "devices/matching/platform_force.h"
#include "engine/systems.h"
#include "engine/thimbles/fitted.h"

namespace palpate {

namespace {

/// Whether a sample that touches is pressed from beside the pad, which no platform renders.
bool beside(const ContactSurface& surface, const Matching& m, std::size_t sample) {
    return surface.touches[sample] && !m.points[sample].touches;
}

/// The force on the finger along the platform's normal, as joint torques; and a place beyond the contact, at which the
/// platform would arrive if nothing held it.
void command_force(const ContactSurface& surface, Matching& m) {
    const ForceModeSettings settings;
    const bool touches = m.result.status != MatchingStatus::no_contact;
    const Eigen::Vector3d normal = m.model.kind->platform(m.model, m.result.w).normal;
    Vec3<double> total = surface.total;
    for (std::size_t s = 0; s < surface.force.size(); ++s)
        if (beside(surface, m, s)) total = total - surface.force[s];
    const Vec3<double> f = transposed_times(rotation_matrix(surface.bone.rotation), total);
    const Eigen::Vector3d on_finger = m.model.mount.linear().transpose() * Eigen::Vector3d(f.x, f.y, f.z);
    m.force_N = touches ? std::clamp(on_finger.dot(normal), 0.0, m.model.max_force) : 0;
    const Coordinates aim = touches ? pressed_on(m.model, m.result.w, settings.press) : m.result.w;
    m.q = m.model.kind->joints(m.model, aim).q;
    m.torque = torques_for_force(m.model, m.result.w, touches ? m.force_N : settings.moving_share * m.model.max_force)
                   .cwiseAbs();
}

/// The match of this rendering step, for a device that can do what `model` says.
void solve_match(const ContactSurface& surface, const DeviceModel& model, const Coordinates& start, Matching& m,
                 ForceMatcher* forces) {
    m.result = match(m.method, model, m.points, m.settings, start);
    if (!forces) return;
    m.geometric = m.result;
    const Mat3<double> R = rotation_matrix(surface.bone.rotation);
    for (std::size_t s = 0; s < surface.force.size(); ++s) {
        const Vec3<double> f = beside(surface, m, s) ? Vec3<double>{0, 0, 0} : transposed_times(R, surface.force[s]);
        for (int d = 0; d < 3; ++d) forces->wanted[std::ptrdiff_t(3 * s) + d] = f[d];
    }
    m.result = match_forces(*forces, model, m.points, m.settings, start, m.geometric);
}

/// Samples as the matching sees them: where the skin is that touches, which is outside its nodes where it is curved
/// between them. What presses from beside the pad (a neighbouring finger, the wall of a groove) is none of the
/// platform's contact: it cannot be there, and would be drawn deep into the pad on its way.
void read_samples(const ContactSurface& surface, Matching& m) {
    const Eigen::Isometry3d to_device = m.model.mount.inverse();
    const Eigen::Vector3d rest = m.model.mount.linear() * m.model.kind->platform(m.model, m.model.rest).normal;
    const Vec3<double> towards_finger =
        rotation_matrix(surface.bone.rotation) * Vec3<double>{rest.x(), rest.y(), rest.z()};
    const double mean_area =
        std::accumulate(surface.area.begin(), surface.area.end(), 0.0) / double(surface.area.size());
    m.beside_N = 0;
    for (std::size_t s = 0; s < surface.position.size(); ++s) {
        const Vec3<double> p = surface.bulge.empty() ? surface.position[s] : surface.position[s] + surface.bulge[s];
        m.points[s].position = to_device * Eigen::Vector3d(p.x, p.y, p.z);
        const double force = norm(surface.pressing[s]);
        const bool from_beside = dot(surface.pressing[s], towards_finger) < fitted::from_beside * force;
        m.points[s].touches = surface.touches[s] && !from_beside;
        m.points[s].weight = surface.area[s] / mean_area;
        if (beside(surface, m, s)) m.beside_N += force;
    }
}

void match_one(const ContactSurface& surface, Matching& m, ForceMatcher* forces) {
    read_samples(surface, m);
    const Coordinates last = m.solves > 0 ? m.result.w : m.model.rest;
    const Coordinates start = forces && m.solves > 0 ? m.geometric.w : last;
    if (m.settings.joint_speed > 0) {
        const DeviceModel near = within_a_step(m.model, last, m.settings.joint_speed * m.since_last);
        solve_match(surface, near, move_inside_limits(near, last, start - last), m, forces);
        // One that went as far as its speed let it is not at the edge of the workspace.
        m.result.constraint_active = at_a_limit(m.model, m.result.q);
    } else {
        solve_match(surface, m.model, start, m, forces);
    }
    if (m.force_mode) command_force(surface, m);
    ++m.solves;
    m.beside_solves += m.beside_N > 0;
    m.contact_solves += m.result.status != MatchingStatus::no_contact;
    m.constrained_solves += m.result.status != MatchingStatus::no_contact && m.result.constraint_active;
    m.failures += m.result.status == MatchingStatus::kept;
}

}  // namespace

void match_devices(const Table<ContactSurface>& surfaces, double time, Threads& threads, Table<Matching>& matchings,
                   Table<ForceMatcher>& force_matchers) {
    int due = 0;
    for (Matching& m : matchings) {
        m.fresh = time >= m.next - 1e-9;
        if (surfaces.find(m.finger)->rough) m.fresh = false;  // waits for the next step
        if (m.fresh) m.next = (m.solves ? m.next : time) + m.period;
        if (m.fresh && m.next <= time) m.next = time + m.period;  // periods shorter than the step
        if (m.fresh) m.since_last = m.solves ? time - m.solved_at : m.period, m.solved_at = time;
        due += m.fresh;
    }
    if (due == 0) return;
    auto solve = [&](int i) {
        const auto row = std::size_t(i);
        Matching& m = matchings[row];
        if (m.fresh) match_one(*surfaces.find(m.finger), m, force_matchers.find(matchings.owner(row)));
    };
    threads.for_each(int(matchings.size()), solve);
}

namespace {

/// Nearer to rest while its tracker is silent, nearer to the match otherwise.
void retreat(DeviceLink& link, const TrackerPose& tracker, double dt) {
    const bool silent = tracker.silent > link.silence;
    if (silent && link.retreat == 0) ++link.retreats;
    link.retreat = std::clamp(link.retreat + (silent ? dt / link.retreat_time : -dt / link.return_time), 0.0, 1.0);
}

/// A share of the way from a command to the rest configuration, pushing ever less.
void lead_to_rest(const Matching& m, double share, ThimbleCommand& command) {
    const Coordinates rest = m.model.kind->joints(m.model, m.model.rest).q;
    command.q += share * (rest - command.q);
    if (command.torque.size() == 0) return;
    const double moving = ForceModeSettings{}.moving_share * m.model.max_force;
    const Coordinates least = torques_for_force(m.model, m.model.rest, moving).cwiseAbs();
    command.torque = ((1 - share) * command.torque).cwiseMax(share * least);
}

}  // namespace

void publish(const Table<TrackerPose>& trackers, const Table<Coupling>& couplings, const Table<Matching>& matchings,
             double time, double dt, double sampled_at, Table<DeviceLink>& links) {
    for (std::size_t row = 0; row < links.size(); ++row) {
        const Matching* m = matchings.find(links.owner(row));
        if (!m) continue;
        retreat(links[row], *trackers.find(couplings.find(m->finger)->tracker), dt);
        if (!m->fresh || !links[row].mailbox) continue;
        const bool valid = m->result.status != MatchingStatus::kept;
        ThimbleCommand command{time, m->force_mode ? m->q : m->result.q, valid, sampled_at};
        if (m->force_mode) command.torque = m->torque;
        if (links[row].retreat > 0) lead_to_rest(*m, links[row].retreat, command);
        links[row].mailbox->publish(command);
    }
}

}  // namespace palpate
