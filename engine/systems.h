#pragma once
// The systems of the step, in its order. Each names what it reads (const) and writes.

#include <oneapi/tbb/task_arena.h>

#include "engine/world.h"

namespace palpate {

/// Takes the incoming sample of each tracker if it is valid, filtered where the tracker has a filter; counts the
/// others.
void read_trackers(Table<TrackerPose>& trackers, Table<PoseFilter>& filters);

/// Aims each finger's bone at its tracked pose: writes the bone springs of its lane.
void couple(const Table<TrackerPose>& trackers, const SolverSettings& solver, const Table<Skin>& skins,
            Table<Coupling>& couplings, std::vector<SkinChunk<double>>& double_chunks,
            std::vector<SkinChunk<float>>& float_chunks);

/// Gives each chunk the objects near it. Returns the number of chunks near more objects than they can hold.
int detect_contacts(const Table<RigidShape>& shapes, const Table<RigidBody>& bodies, const SolverSettings& solver,
                    std::vector<SkinChunk<double>>& double_chunks, std::vector<SkinChunk<float>>& float_chunks);

/// Wakes the fingers that an object has come near to, or whose target moves, and moves those that are solved together,
/// into as few and as narrow chunks as they fit: lanes of a chunk cost the same whether solved or not. `step` counts
/// steps.
void gather_lanes(const SolverSettings& solver, std::int64_t step, Table<Skin>& skins,
                  std::vector<SkinChunk<double>>& double_chunks, std::vector<SkinChunk<float>>& float_chunks);

/// One implicit step of every chunk (skin/newton.h) that is near no body, chunks in parallel.
void solve_skins(const SolverSettings& solver, oneapi::tbb::task_arena& arena,
                 std::vector<SkinChunk<double>>& double_chunks, std::vector<SkinChunk<float>>& float_chunks);

/// Lets go of bodies whose release has come, and guesses for detect_contacts where bodies would coast to.
void begin_bodies(const SolverSettings& solver, double time, Table<RigidShape>& shapes, Table<RigidBody>& bodies);

/// One implicit step of every body, and of every chunk near one: bones, skin and bodies in one solve.
void solve_bodies(const SolverSettings& solver, const Vec3<double>& gravity,
                  const std::vector<PairFriction>& pair_frictions, oneapi::tbb::task_arena& arena,
                  Table<RigidShape>& shapes, Table<RigidBody>& bodies, BodySolve& solve,
                  std::vector<SkinChunk<double>>& double_chunks, std::vector<SkinChunk<float>>& float_chunks);

/// Reads touching samples, forces and area of each finger from its lane.
void extract_contact(const Table<Skin>& skins, const std::vector<SkinChunk<double>>& double_chunks,
                     const std::vector<SkinChunk<float>>& float_chunks, Table<Coupling>& couplings,
                     Table<ContactSurface>& surfaces);

/// Solves the thimbles that are due, in parallel.
void match_devices(const Table<ContactSurface>& surfaces, double time, oneapi::tbb::task_arena& arena,
                   Table<Matching>& matchings, Table<ForceMatcher>& force_matchers);

/// Puts each fresh result into its thimble's mailbox.
void publish(const Table<Matching>& matchings, double time, double sampled_at, Table<DeviceLink>& links);

}  // namespace palpate
