#pragma once
// What the bodies' solve works on, and how it groups lanes and bodies into islands.

#include "engine/bodies/fitted.h"
#include "engine/skin/solve/kernels.h"
#include "engine/threads.h"
#include "engine/world.h"

namespace palpate {

/// What the solve works on.
struct BodyWork {
    const SolverSettings& solver;
    Threads& threads;
    Table<VirtualObject>& shapes;
    Table<RigidBody>& bodies;
    BodySolve& s;
    SkinChunks& chunks;
    double time;  ///< simulated, at the end of the step [s]
    const Table<Skin>& skins;
    FingerPairs& pairs;  ///< the planes between fingers come after all bodies
    SoftObjects& soft;
};

/// Whether a row of BodySolve::bodies is a plane between fingers.
inline bool is_plane(const BodyWork& w, int body) { return body >= int(w.bodies.size()); }
using fitted::plane_size;
inline double size_of(const BodyWork& w, int body) {
    return is_plane(w, body) ? plane_size : w.bodies[std::size_t(body)].size;
}

/// Calls visit(chunk, kernel) for a coupled chunk, whatever its precision.
template <class Visit>
void with_chunk(const BodyWork& w, int coupled, Visit visit) {
    w.chunks.with(w.s.coupled[coupled], [&](auto& c) { visit(c, kernel_for(c).coupled); });
}

inline int island_of(const BodyWork& w, int coupled, int lane) { return w.s.lane_island[16 * coupled + lane]; }

/// Bits of the lanes whose island fulfils a condition.
template <class Condition>
unsigned lanes_where(const BodyWork& w, int coupled, Condition condition) {
    unsigned lanes = 0;
    for (int lane = 0; lane < 16; ++lane) {
        const int i = island_of(w, coupled, lane);
        if (i >= 0 && condition(w.s.islands[i])) lanes |= 1u << lane;
    }
    return lanes;
}

/// Calls visit(chunk, kernel, lanes) for a coupled chunk that has lanes whose island fulfils a condition.
template <class Condition, class Visit>
void with_lanes(const BodyWork& w, int coupled, Condition condition, Visit visit) {
    const unsigned lanes = lanes_where(w, coupled, condition);
    if (lanes) with_chunk(w, coupled, [&](auto& c, const auto& kernel) { visit(c, kernel, lanes); });
}

/// The same for all of them, in parallel.
template <class Condition, class Visit>
void for_each_chunk(const BodyWork& w, Condition condition, Visit visit) {
    const int count = int(w.s.coupled.size());
    if (count == 1) return with_lanes(w, 0, condition, visit);
    w.threads.for_each(count, [&](int k) { with_lanes(w, k, condition, visit); });
}
/// And something else beside them.
template <class Condition, class Visit, class Beside>
void for_each_chunk(const BodyWork& w, Condition condition, Visit visit, Beside beside) {
    const int count = int(w.s.coupled.size());
    auto one = [&](int k) { k < count ? with_lanes(w, k, condition, visit) : beside(); };
    if (count > 1) return w.threads.for_each(count + 1, one);
    for (int k = 0; k <= count; ++k) one(k);
}

/// Calls visit(chunk, lane, island) for every lane, one after the other, by their fingers' numbers.
template <class Visit>
void for_each_lane(const BodyWork& w, Visit visit) {
    for (const auto& [finger, place] : w.s.fingers)
        with_chunk(w, place / 16, [&, lane = place % 16, island = w.s.lane_island[place]](auto& c, const auto&) {
            visit(c, lane, w.s.islands[island]);
        });
}

/// Calls visit(slot, body) for the slots with a body that a lane may touch.
template <class T, class Visit>
void for_each_body_of(const BodyWork& w, const SkinChunk<T>& c, int lane, Visit visit) {
    for (int slot = 0; slot < c.contacts.count[std::size_t(lane)]; ++slot)
        if (const int body = c.contacts.at(slot, lane).body; body >= 0) visit(slot, w.s.bodies[body]);
}

/// The island of the bodies that a pair connects.
Island& island_of_pair(BodyWork& work, const BodyPair& pair);

/// Memory for so many bodies and planes between fingers.
void reserve_islands(BodySolve& solve, int places, int chunks);

/// Places for further pairs of objects: `at_least` for each object, and as many as it is near to. Allocates: at load,
/// and once for an object that more others come near to than ever before.
void grow_pairs(BodySolve& solve, int at_least);

/// Bodies at the start of the step, objects, chunks near bodies, pairs of objects near each other, islands.
void find_islands(BodyWork& work, const Vec3<double>& gravity, const std::vector<PairFriction>& pair_frictions);

/// Puts bodies where the solve has them, or where their step ends.
void place_bodies(BodyWork& work, bool at_end_of_step);

/// Puts each plane between fingers where what presses on it balances to the last bit that matters, whether the solve
/// has converged or not, and keeps the fingers' forces as they then are.
void balance_planes(BodyWork& work);

/// Whether forces of contact on a body miss what acted on it by more than so many times that, where a solve ended
/// early.
bool misses_what_acted(const RigidBody& body, const BodyProgress& progress, double times);

/// What acted on a body is what became of it: what its motion was changed by after the solve is a force of contact,
/// too.
void report_what_acted(const BodyWork& w, RigidBody& body, const BodyProgress& progress);

/// Marks islands that something that moves by a track may touch (Island::driven).
void mark_driven(BodyWork& work);
/// No contact gives a body more energy than what it belongs to has lost: takes the rest from its velocity. Where a long
/// step takes a body past something round, the force at the end of its way lies along that way, and works.
void brake_gains(BodyWork& work);
/// Bodies that only each other have touched keep their momentum, and those that nothing has touched fly on, however the
/// solve has ended (keep_momentum.cpp).
void keep_momentum(BodyWork& work);

/// Whether an overlap of a pair has been undone in this step.
bool is_recovering(const BodyPair& pair);

/// The motion that undid overlaps is no velocity: takes its share of the speed at which objects part away again, by
/// impulses that pull (projected Gauss-Seidel; the nearest velocities, by kinetic energy, that part no faster, so that
/// none is gained).
void brake_recovery(BodyWork& work);

/// Bounces: gives bodies back a share of the speed at which they met, by impulses that push (projected Gauss-Seidel:
/// the nearest velocities, by kinetic energy, that part so fast. Sums of impulses, not each addition, push: velocities
/// are then the same in whatever order contacts come), and that rub by Coulomb's law: a step's own contact takes but
/// the part of the blow that was left when they met.
void bounce(BodyWork& work);

/// Takes over where the solve has brought lanes and bodies: velocities and statuses; bounces; puts bodies to sleep.
void end_body_step(BodyWork& work);

}  // namespace palpate
