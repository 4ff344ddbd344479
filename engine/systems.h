#pragma once
// The systems of the step, in its order. Each names what it reads (const) and writes.

#include <chrono>

#include "engine/threads.h"
#include "engine/world.h"

namespace palpate {

/// Says by when the solves of this step are to stop (step_cut.h): at the deadline after its `start`, but for a
/// `reserve` [s] for what follows them; or where the step that is repeated did.
void begin_cuts(std::chrono::steady_clock::time_point start, double reserve, const StepDeadline& deadline,
                SkinChunks& chunks, BodySolve& bodies);

/// Notes which were cut short. Nothing without a deadline.
void end_cuts(StepDeadline& deadline, SkinChunks& chunks, BodySolve& bodies);

/// Takes the incoming sample of each tracker if it is valid, filtered where the tracker has a filter; counts the
/// others.
void read_trackers(double dt, Table<TrackerPose>& trackers, Table<PoseFilter>& filters);

/// Aims each finger's bone at its tracked pose: writes the bone springs of its lane.
void couple(const Table<TrackerPose>& trackers, const SolverSettings& solver, const Table<Skin>& skins,
            Table<Coupling>& couplings, SkinChunks& chunks);

/// Holds the fixed part of soft objects at their objects' poses: writes the bone springs of their lanes.
void hold_soft_objects(const Table<VirtualObject>& shapes, const SolverSettings& solver, SoftObjects& soft,
                       SkinChunks& chunks);

/// Lets go of bodies whose release has come, and guesses for detect_contacts where bodies would coast to.
void begin_bodies(const SolverSettings& solver, double time, Table<VirtualObject>& shapes, Table<RigidBody>& bodies);

/// Gives each finger the objects near it, as many as there are. Returns how often that took more memory than there was:
/// the only allocation in a step that the engine makes itself, once for each further object that is near a finger at
/// the same time.
int detect_contacts(const Table<VirtualObject>& shapes, const Table<RigidBody>& bodies, const SolverSettings& solver,
                    Threads& threads, SkinChunks& chunks);

/// Finds the fingers near each other, and gives each the planes between it and others (finger_pairs.h). Returns how
/// often that took more memory than there was: where fingers come near each other for the first time, and as above.
int detect_finger_pairs(const Table<VirtualObject>& shapes, const Table<RigidBody>& bodies, const Table<Skin>& skins,
                        const SolverSettings& solver, BodySolve& solve, FingerPairs& pairs, SkinChunks& chunks);

/// Finds which samples of which fingers may touch which faces of soft objects (soft_objects.h). Allocates nothing.
void detect_soft_contacts(const Table<VirtualObject>& shapes, const Table<Skin>& skins, const SolverSettings& solver,
                          SoftObjects& soft, SkinChunks& chunks);

/// Wakes the fingers that an object has come near to, or whose target moves, and chooses what the solve leaves out of
/// each (level_of_detail.h). `step` counts steps.
void choose_detail(const SolverSettings& solver, std::int64_t step, SkinChunks& chunks);

/// Moves fingers that are solved together into as few and as narrow chunks as they fit: lanes of a chunk cost the same
/// whether solved or not.
void gather_lanes(Table<Skin>& skins, SkinChunks& chunks);

/// Lets each large finger that is alone in its chunk factor its matrix on these threads, in this step.
void lend_threads(Threads& threads, SkinChunks& chunks);

/// One implicit step of every chunk (solve/solve_lanes.h) that is near no body, chunks in parallel. The contact of
/// chunks that take turns at work memory is read at once (extract_chunk): what is read is still in the cache then, and
/// much of it outlives no step. Returns what that took of the time [s].
double solve_skins(const SolverSettings& solver, const Table<Skin>& skins, Threads& threads, SkinChunks& chunks,
                   Table<Coupling>& couplings, Table<ContactSurface>& surfaces);
/// Whether there are fingers for solve_skins and others for solve_bodies, and neither writes what the other reads.
bool solved_apart(const SkinChunks& chunks);

/// One implicit step of every body, to the simulated `time` [s], and of every chunk near one, or with fingers near each
/// other: bones, skin, bodies and the planes between fingers in one solve.
void solve_bodies(const SolverSettings& solver, const Vec3<double>& gravity,
                  const std::vector<PairFriction>& pair_frictions, double time, const Table<Skin>& skins,
                  Threads& threads, Table<VirtualObject>& shapes, Table<RigidBody>& bodies, FingerPairs& pairs,
                  SoftObjects& soft, BodySolve& solve, SkinChunks& chunks);

/// Reads touching samples, forces and area of each finger of a chunk from its lane. Says in its status which nodes are
/// pressed from inside, and that such a step has not converged; nor has a finger whose own forces are off balance by
/// more than three times `tolerance` (of the solver, relative).
void extract_chunk(int chunk, const Table<Skin>& skins, double tolerance, SkinChunks& chunks,
                   Table<Coupling>& couplings, Table<ContactSurface>& surfaces);

/// The same of the fingers of all chunks but those that solve_skins has read, and of soft objects.
void extract_contact(const Table<Skin>& skins, double tolerance, Threads& threads, const FingerPairs& pairs,
                     SoftObjects& soft, SkinChunks& chunks, Table<Coupling>& couplings,
                     Table<ContactSurface>& surfaces);

/// Notes which objects have come into soft objects between their samples, and that in such a step neither has
/// converged.
void find_entered_tissue(double time, SoftObjects& soft, SkinChunks& chunks, Table<RigidBody>& bodies);

/// Solves the thimbles that are due, in parallel.
void match_devices(const Table<ContactSurface>& surfaces, double time, Threads& threads, Table<Matching>& matchings,
                   Table<ForceMatcher>& force_matchers);

/// Puts each fresh result into its thimble's mailbox; of a thimble whose finger's tracker is silent, one nearer to
/// rest.
void publish(const Table<TrackerPose>& trackers, const Table<Coupling>& couplings, const Table<Matching>& matchings,
             double time, double dt, double sampled_at, Table<DeviceLink>& links);

/// Poses of objects at the end of this step become those at the beginning of the next.
void end_objects(Table<VirtualObject>& shapes);

}  // namespace palpate
