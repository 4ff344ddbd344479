#include <oneapi/tbb/parallel_for.h>

#include "engine/systems.h"

namespace palpate {

namespace {

void match_one(const ContactSurface& surface, Matching& m, ForceMatcher* forces) {
    const Eigen::Isometry3d to_device = m.model.mount.inverse();
    for (std::size_t s = 0; s < surface.position.size(); ++s) {
        const Vec3<double>& p = surface.position[s];
        m.points[s].position = to_device * Eigen::Vector3d(p.x, p.y, p.z);
        m.points[s].touches = surface.touches[s] != 0;
    }
    const Coordinates previous = m.solves > 0 ? m.result.w : m.model.rest;
    m.result = match(m.method, m.model, m.points, m.settings, forces ? m.geometric.w : previous);
    if (forces) {
        m.geometric = m.result;
        const Mat3<double> R = rotation_matrix(surface.bone.rotation);
        for (std::size_t s = 0; s < surface.force.size(); ++s) {
            const Vec3<double> f = transposed_times(R, surface.force[s]);
            for (int d = 0; d < 3; ++d) forces->wanted[std::ptrdiff_t(3 * s) + d] = f[d];
        }
        m.result = match_forces(*forces, m.model, m.settings, m.geometric);
    }
    ++m.solves;
    m.contact_solves += m.result.status != MatchingStatus::no_contact;
    m.constrained_solves += m.result.status != MatchingStatus::no_contact && m.result.constraint_active;
    m.failures += m.result.status == MatchingStatus::kept;
}

}  // namespace

void match_devices(const Table<ContactSurface>& surfaces, double time, oneapi::tbb::task_arena& arena,
                   Table<Matching>& matchings, Table<ForceMatcher>& force_matchers) {
    int due = 0;
    for (Matching& m : matchings) {
        m.fresh = time >= m.next - 1e-9;
        if (m.fresh) m.next = (m.solves ? m.next : time) + m.period;
        if (m.fresh && m.next <= time) m.next = time + m.period;  // periods shorter than the step
        due += m.fresh;
    }
    if (due == 0) return;
    auto solve = [&](std::size_t row) {
        Matching& m = matchings[row];
        if (m.fresh) match_one(*surfaces.find(m.finger), m, force_matchers.find(matchings.owner(row)));
    };
    arena.execute(
        [&] { oneapi::tbb::parallel_for(std::size_t(0), matchings.size(), solve, oneapi::tbb::simple_partitioner()); });
}

void publish(const Table<Matching>& matchings, double time, double sampled_at, Table<DeviceLink>& links) {
    for (std::size_t row = 0; row < links.size(); ++row) {
        const Matching* m = matchings.find(links.owner(row));
        if (!m || !m->fresh || !links[row].mailbox) continue;
        links[row].mailbox->publish({time, m->result.q, m->result.status != MatchingStatus::kept, sampled_at});
    }
}

}  // namespace palpate
