#pragma once
// Recorded runs: what went in, and what came out of every step, in a file of frames (frames.h) that is named "palpate2"
// by its first 8 bytes. What each kind of frame holds, all numbers little-endian:
//
//   1 run: a run begins. JSON: version, scene (path), text (of the scene file), files (that it names: file, bytes, hash
//     of them, FNV-1a), overrides, fingers, objects (names, in order), arrays (names of what is hashed), governed,
//     fingers_touch (each other), conforming, patches_limited, dt_s, duration_s; has_file (false: the scene was given
//     as text).
//   3 step: u64 number of the step; f64 time; i8 preset of the governor (-1: none); u32 fingers, objects, arrays,
//   moved;
//     per finger u8 valid, f64 sample time, tracked pose, 3 f64 contact force after the step [N]; per object its pose
//     before the step; per array u64 hash of its bytes after the step; per object that forces move u32 row, pose after
//     the step. A pose is 7 f64: p [m], q = w x y z.
//   4 arrays: from the next step on these are hashed (a body is released). JSON: arrays.
//   5 settings: the run goes on with other settings. JSON: overrides.
//   7 cuts: the next step was cut short by its deadline. Per chunk of fingers, doubles and then floats, and last for
//     bodies, i32 pass of the iteration at which it was (-1: it was not). Palpate repeats them instead of asking the
//     clock; who does not know them gets other numbers.
//   6 end: the run was ended in order. u64 steps recorded of it.
//
// Files that begin with "palpate1" hold one run: kind 1 and kind 2 (one per step): f64 time; per finger u8 valid, f64
// sample time, pose; per object its pose; per array u64 hash, and further ones of bodies that were released; per finger
// 3 f64 force; where the header says "governed" u8 preset.

#include <memory>

#include "scenes/recording/file_stamp.h"
#include "scenes/recording/frames.h"
#include "scenes/run/simulation.h"

namespace palpate {

struct MovedObject {
    int object;         ///< row
    Pose<double> pose;  ///< after the step
};

/// What a step left behind: a hash of every array that must come out the same again, and forces and poses for people.
struct StepOutcome {
    std::vector<std::uint64_t> hashes;
    std::vector<Vec3<double>> forces;  ///< per finger [N]
    std::vector<MovedObject> moved;    ///< objects that forces move
};
StepOutcome outcome_of(const Simulation& simulation);
/// Names of the hashed arrays, in order, as they are now: those of a body begin when it is released. Hashed are
/// positions and forces by node, whatever order and precision the solver keeps them in.
std::vector<std::string> array_names(const Simulation& simulation);

class RunWriter {
  public:
    /// Makes the file, or empties it, and begins a run. Throws where the file cannot be written.
    RunWriter(const std::filesystem::path& path, const Simulation& simulation,
              const std::vector<std::string>& overrides);
    /// Another run begins, or the same one anew: after `finish`.
    void begin(const Simulation& simulation, const std::vector<std::string>& overrides);
    /// The run goes on with other settings, carried over into `simulation` (run/carry_over.h).
    void change_settings(const Simulation& simulation, const std::vector<std::string>& overrides);
    /// Call after every step with its inputs.
    void record(const StepInputs& inputs, const Simulation& simulation);
    /// The run ended in order.
    void finish();
    /// Why nothing more could be written (the disk is full); empty while all is well.
    const std::string& failure() const { return file_.failure(); }

  private:
    FrameWriter file_;
    std::vector<char> moving_;  ///< per object: forces move it
    std::uint64_t steps_ = 0;   ///< of this run
};

struct RecordedStep {
    std::int64_t number;
    double time;
    StepInputs inputs;
    StepOutcome outcome;
    std::shared_ptr<const std::vector<std::string>> arrays;  ///< names of the hashes; null: the file does not say
};

struct RecordedRun {
    /// From step `step` (row) on the run has other settings.
    struct Change {
        std::size_t step;
        std::vector<std::string> overrides;
    };
    /// Before step `step` (row) bytes were damaged.
    struct Gap {
        std::size_t step, bytes;
    };
    std::string scene, text;
    std::vector<std::string> overrides, fingers, objects, arrays;
    std::vector<FileStamp> files;    ///< that the scene names; files from before they were kept say none
    bool has_file = true;            ///< false: the scene was given as text, `scene` says which folder its files are in
    bool governed = false;           ///< a governor chose each step's preset
    bool fingers_touch = false;      ///< each other; files from before they could do not say
    bool conforming = false;         ///< fingers of which nothing is said have such meshes; nor do these say this
    bool patches_limited = false;    ///< nor that strain limits of these are of patches
    bool keeps_matrices = false;     ///< nor that Newton matrices are kept from step to step
    bool spares_iterations = false;  ///< nor that `balanced` spares iterations where forces are balanced
    bool fast_spares = false;        ///< nor that `fast` does
    double duration = 0;             ///< asked for [s]; 0: the file does not say
    std::vector<RecordedStep> steps;
    std::vector<Change> changes;
    std::vector<Gap> gaps;
    bool ended = false;  ///< in order
};

struct Recording {
    int version = 2;
    std::vector<RecordedRun> runs;
    std::size_t unread_bytes = 0;     ///< after the last complete frame
    std::size_t unknown_frames = 0;   ///< whole, but of a kind that this program does not know
    std::vector<std::string> losses;  ///< sentences about what is missing; empty: nothing is
};

/// Reads all complete frames. Throws InputError for what is no recording, or has no header left.
Recording read_recording(const std::filesystem::path& path);

/// The recorded scene with these overrides, if its file still says what it said then. Throws InputError with the remedy
/// if not. That a file which it names has changed is one of its warnings.
Scene recorded_scene(const RecordedRun& run, const std::filesystem::path& file,
                     const std::vector<std::string>& overrides);

}  // namespace palpate
