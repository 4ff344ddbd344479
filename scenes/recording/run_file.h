#pragma once
// A recorded run: what went in, and what came out of every step. The file grows by whole frames with checksums, so that
// everything up to the last complete frame can be read after a crash or a kill.
//
// Layout, little-endian: 8 bytes "palpate1"; then frames of u32 size, u32 kind, payload, u32 CRC-32 of kind and
// payload. Kind 1 (first frame): JSON with scene (path), text (of the scene file), overrides, fingers, objects, arrays
// (names). Kind 2 (one per step): f64 time; per finger: u8 valid, f64 sample time, 7 f64 tracked pose (p, q = w x y z);
// per object: 7 f64 pose; per array: u64 hash of its bytes after the step; per finger: 3 f64 contact force [N]; where
// the header says "governed": u8 preset of the step.

#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "scenes/simulation.h"

namespace palpate {

/// What a step left behind: a hash of every array that must come out the same again, and the forces for people.
struct StepOutcome {
    std::vector<std::uint64_t> hashes;
    std::vector<Vec3<double>> forces;  ///< per finger [N]
};
StepOutcome outcome_of(const Simulation& simulation);
/// Names of the hashed arrays, in order.
std::vector<std::string> array_names(const Simulation& simulation);

struct RecordedStep {
    double time;
    StepInputs inputs;
    StepOutcome outcome;
};

class RunWriter {
  public:
    /// Throws InputError where the file cannot be written.
    RunWriter(const std::filesystem::path& path, const Simulation& simulation,
              const std::vector<std::string>& overrides);
    /// Call after every step with its inputs.
    void record(const StepInputs& inputs, const Simulation& simulation);

  private:
    void frame(std::uint32_t kind, const std::vector<std::uint8_t>& payload);
    std::filesystem::path path_;
    std::unique_ptr<std::FILE, int (*)(std::FILE*)> file_;
};

struct RecordedRun {
    std::string scene, text;
    std::vector<std::string> overrides, fingers, objects, arrays;
    bool governed = false;  ///< a governor chose each step's preset
    std::vector<RecordedStep> steps;
    std::size_t unread_bytes = 0;  ///< after the last complete frame
};

/// The recorded scene, if its file still says what it said then. Throws InputError with the remedy if not.
Scene recorded_scene(const RecordedRun& run, const std::filesystem::path& file);

/// Reads up to the last complete frame. Throws InputError for what is no recorded run.
RecordedRun read_run(const std::filesystem::path& path);

}  // namespace palpate
