#pragma once
// The tables of a run, written while it goes on: what a killed run leaves behind.

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "scenes/run/simulation.h"

namespace palpate {

/// Names and series of a simulation's tables: NAME.csv per finger, object_NAME.csv per body, steps.csv.
struct NamedSeries {
    std::string file;
    const Series* series;
};
std::vector<NamedSeries> tables_of(const Simulation& simulation);

/// Writes them, as write_csv does, into a folder that exists: about once a second, from a thread of its own, so that a
/// step waits for no disk. Beside them UNFINISHED.txt says what they are, until `finish`.
class LiveTables {
  public:
    /// Throws as throw_unwritable (mesh_files.h).
    LiveTables(const std::filesystem::path& folder, const Simulation& simulation);
    ~LiveTables();
    LiveTables(const LiveTables&) = delete;
    LiveTables& operator=(const LiveTables&) = delete;
    /// Call after every step. Does not wait.
    void record(const Simulation& simulation);
    /// The run is over: what is missing is written. Throws as throw_unwritable what could not be.
    void finish(const Simulation& simulation);

    static constexpr const char* note = "UNFINISHED.txt";

  private:
    struct Work;
    std::unique_ptr<Work> work_;
};

}  // namespace palpate
