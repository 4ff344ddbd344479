#pragma once
// The results folder of a run.

#include <filesystem>
#include <vector>

#include "scenes/picture/still.h"
#include "scenes/run/summary.h"

namespace palpate {

/// Writes series (CSV), plots (SVG), a picture (PNG), final pads (VTU) and the summary (JSON, text) into `folder`,
/// which exists: a ResultsFolder's part. `live`: the series are there (live_tables.h). Throws as throw_unwritable
/// (mesh_files.h).
void write_results(const std::filesystem::path& folder, const Simulation& simulation, const Summary& summary,
                   const PictureSettings& picture = {}, bool live = false);

/// A finger's mesh where it is now, with displacement, contact force, bone reaction and pressure per node and
/// principal stretches per element.
void write_pad(const std::filesystem::path& path, const World& world, EntityId finger);

/// The same per node as a table (CSV): rest position carried by the bone [mm], displacement from it [mm], contact
/// force [N] and bone reaction [N], world frame.
void write_nodes(const std::filesystem::path& path, const World& world, EntityId finger);

/// Pads over time for ParaView: NAME_0000.vtu, ... and NAME.pvd per finger, no more often than `rate` per simulated
/// second, into a folder that exists. Throws as throw_unwritable, and as
/// refuse_colliding_pads.
class PadSeries {
  public:
    PadSeries(std::filesystem::path folder, double rate);
    /// Call after every step.
    void record(const Simulation& simulation);
    /// Writes the .pvd files.
    void finish(const Simulation& simulation) const;

  private:
    std::filesystem::path folder_;
    double rate_, next_ = 0;
    std::vector<double> times_;
};

}  // namespace palpate
