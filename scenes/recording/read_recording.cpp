// Reading recordings, of both versions.

#include <algorithm>
#include <nlohmann/json.hpp>
#include <utility>

#include "meshes/input_error.h"
#include "meshes/mesh_files.h"
#include "meshes/plain_numbers.h"
#include "scenes/recording/run_file.h"
#include "scenes/web/bounded_json.h"

namespace palpate {

namespace {

using Names = std::vector<std::string>;

Pose<double> get_pose(PayloadReader& in) {
    Pose<double> p;
    for (double* v :
         {&p.position.x, &p.position.y, &p.position.z, &p.rotation.w, &p.rotation.x, &p.rotation.y, &p.rotation.z})
        *v = in.get<double>();
    return p;
}
Vec3<double> get_vector(PayloadReader& in) {
    const double x = in.get<double>(), y = in.get<double>(), z = in.get<double>();
    return {x, y, z};
}
TrackerPose::Sample get_sample(PayloadReader& in) {
    TrackerPose::Sample s;
    s.valid = in.get<std::uint8_t>() != 0;
    s.time = in.get<double>();
    s.pose = get_pose(in);
    return s;
}

/// Kind 2, of version 1: a body that was released adds its hash, unsaid; forces of all fingers stand behind.
bool read_old_step(const Frame& frame, const RecordedRun& run, RecordedStep& step) {
    PayloadReader in(frame);
    const std::size_t fingers = run.fingers.size(), objects = run.objects.size();
    const std::size_t fixed = 8 + fingers * (1 + 8 + 56 + 24) + objects * 56 + (run.governed ? 1 : 0);
    if (frame.size < fixed || (frame.size - fixed) % 8 != 0) return false;
    const std::size_t hashes = (frame.size - fixed) / 8;
    if (hashes < run.arrays.size() || hashes > run.arrays.size() + objects) return false;
    step.number = std::int64_t(run.steps.size()) + 1;
    step.time = in.get<double>();
    for (std::size_t i = 0; i < fingers; ++i) step.inputs.fingers.push_back(get_sample(in));
    for (std::size_t i = 0; i < objects; ++i) step.inputs.objects.push_back(get_pose(in));
    for (std::size_t i = 0; i < hashes; ++i) step.outcome.hashes.push_back(in.get<std::uint64_t>());
    for (std::size_t i = 0; i < fingers; ++i) step.outcome.forces.push_back(get_vector(in));
    if (run.governed) step.inputs.preset = in.get<std::uint8_t>();
    return in.good && step.inputs.preset < int(preset_names().size());
}

/// Kind 3.
bool read_step(const Frame& frame, const RecordedRun& run, RecordedStep& step) {
    PayloadReader in(frame);
    step.number = std::int64_t(in.get<std::uint64_t>());
    step.time = in.get<double>();
    const auto preset = in.get<std::int8_t>();
    step.inputs.preset = preset < 0 ? -1 : static_cast<unsigned char>(preset);
    const auto fingers = in.get<std::uint32_t>(), objects = in.get<std::uint32_t>();
    const std::size_t hashes = in.get<std::uint32_t>(), moved = in.get<std::uint32_t>();
    if (fingers != run.fingers.size() || objects != run.objects.size()) return false;
    if (in.left() != fingers * 89ull + objects * 56ull + hashes * 8 + moved * 60) return false;
    for (std::size_t i = 0; i < fingers; ++i) {
        step.inputs.fingers.push_back(get_sample(in));
        step.outcome.forces.push_back(get_vector(in));
    }
    for (std::size_t i = 0; i < objects; ++i) step.inputs.objects.push_back(get_pose(in));
    for (std::size_t i = 0; i < hashes; ++i) step.outcome.hashes.push_back(in.get<std::uint64_t>());
    for (std::size_t i = 0; i < moved; ++i) {
        const auto object = in.get<std::uint32_t>();
        if (object >= objects) return false;
        step.outcome.moved.push_back({int(object), get_pose(in)});
    }
    return in.good && step.inputs.preset >= -1 && step.inputs.preset < int(preset_names().size());
}

/// A header; throws nlohmann's exceptions where it lacks something.
RecordedRun read_header(const nlohmann::json& j) {
    RecordedRun run;
    run.scene = j.at("scene"), run.text = j.at("text");
    run.overrides = j.at("overrides").get<Names>(), run.arrays = j.at("arrays").get<Names>();
    run.fingers = j.at("fingers").get<Names>(), run.objects = j.at("objects").get<Names>();
    run.has_file = j.value("has_file", true);
    for (const auto& f : j.value("files", nlohmann::json::array()))
        run.files.push_back({f.at("file"), f.at("bytes"), f.at("hash")});
    run.fingers_touch = j.value("fingers_touch", false);
    run.conforming = j.value("conforming", false), run.patches_limited = j.value("patches_limited", false);
    run.keeps_matrices = j.value("keeps_matrices", false);
    run.spares_iterations = j.value("spares_iterations", false), run.fast_spares = j.value("fast_spares", false);
    run.governed = j.value("governed", false), run.duration = j.value("duration_s", 0.0);
    return run;
}

/// Takes a recording's frames in.
struct RecordingReader {
    Recording recording;
    std::shared_ptr<const Names> arrays{};  ///< of the next step; null: unknown
    std::vector<int> cuts{};                ///< of the next step
    std::string wrong_header{};             ///< why the first header cannot be read

    RecordedRun* run() { return recording.runs.empty() ? nullptr : &recording.runs.back(); }

    void gap(std::size_t bytes) {
        arrays.reset();
        if (run()) run()->gaps.push_back({run()->steps.size(), bytes});
    }
    void begin_run(const nlohmann::json& j) {
        recording.runs.push_back(read_header(j));
        arrays = std::make_shared<const Names>(run()->arrays);
    }
    /// False: the frame cannot be used.
    bool take_step(const Frame& frame) {
        if (!run()) return false;
        RecordedStep step{};
        if (!(frame.kind == 2 ? read_old_step(frame, *run(), step) : read_step(frame, *run(), step))) return false;
        if (arrays && arrays->size() == step.outcome.hashes.size()) step.arrays = arrays;
        step.inputs.cuts = std::exchange(cuts, {});
        run()->steps.push_back(std::move(step));
        return true;
    }
    bool take(const Frame& frame) {
        if (frame.kind == 2 || frame.kind == 3) return take_step(frame);
        if (frame.kind == 6) {
            if (run()) run()->ended = true;
            return true;
        }
        if (frame.kind == 7) {
            PayloadReader in(frame);
            cuts.clear();
            while (in.good && in.left() >= 4) cuts.push_back(in.get<std::int32_t>());
            return in.good && in.left() == 0;
        }
        if (frame.kind != 1 && frame.kind != 4 && frame.kind != 5) {
            ++recording.unknown_frames;
            return true;
        }
        std::string wrong;  // what is discarded throws below
        const auto j = parse_object({reinterpret_cast<const char*>(frame.payload), frame.size}, wrong, file_bounds);
        try {
            if (frame.kind == 1)
                begin_run(j);
            else if (run() && frame.kind == 4)
                arrays = std::make_shared<const Names>(j.at("arrays").get<Names>());
            else if (run())
                run()->changes.push_back({run()->steps.size(), j.at("overrides").get<Names>()});
            return true;
        } catch (const nlohmann::json::exception& error) {
            if (wrong_header.empty()) wrong_header = error.what();
            return false;
        }
    }
};

/// Sentences about what is missing.
std::vector<std::string> losses_of(const Recording& r) {
    std::vector<std::string> out;
    char text[300];
    for (std::size_t i = 0; i < r.runs.size(); ++i) {
        const RecordedRun& run = r.runs[i];
        const std::string which = r.runs.size() > 1 ? "run " + std::to_string(i + 1) + ": " : "";
        for (const RecordedRun::Gap& gap : run.gaps) {
            const std::int64_t before = gap.step > 0 ? run.steps[gap.step - 1].number : 0;
            // A file into which frames were copied once more counts backwards: nothing is known of what is missing
            // then.
            if (gap.step < run.steps.size() && r.version > 1 && run.steps[gap.step].number > before)
                plain_snprintf(text, sizeof text, "%zu bytes are damaged: %lld steps before %.4f s are lost", gap.bytes,
                               static_cast<long long>(run.steps[gap.step].number - before - 1),
                               run.steps[gap.step].time);
            else
                plain_snprintf(text, sizeof text, "%zu bytes are damaged before step %zu", gap.bytes, gap.step + 1);
            out.push_back(which + text);
        }
        if (run.ended || r.version < 2) continue;
        const double until = run.steps.empty() ? 0 : run.steps.back().time;
        plain_snprintf(text, sizeof text,
                       "it was not ended: palpate was killed, or the file was cut off; it holds %zu steps, until "
                       "%.4f s of %.4g s",
                       run.steps.size(), until, run.duration);
        out.push_back(which + text);
    }
    if (r.unread_bytes > 0)
        out.push_back("the last " + std::to_string(r.unread_bytes) +
                      " bytes of the file are no complete frame: the step that was being written is lost, or the file "
                      "was cut off or damaged there");
    if (r.unknown_frames > 0)
        out.push_back(std::to_string(r.unknown_frames) + " frames are of a kind that this palpate does not know");
    return out;
}

}  // namespace

Recording read_recording(const std::filesystem::path& path) {
    const std::string raw = read_file(path);
    const std::string what = path.string() + ": not a recorded run (`palpate run SCENE --record FILE` writes one): ";
    const std::string_view name = std::string_view(raw).substr(0, 8);
    if (name != "palpate1" && name != "palpate2")
        throw InputError(name.starts_with("palpate") && name.size() == 8
                             ? path.string() + ": recorded by another palpate (version '" +
                                   std::string(name.substr(7)) + "' of the file; this one reads 1 and 2)"
                             : what + "it does not begin with \"palpate2\"");
    RecordingReader reader;
    reader.recording.version = name.back() - '0';
    reader.recording.unread_bytes = for_each_frame(
        raw, 8,
        [&](const Frame& frame) {
            if (!reader.take(frame)) reader.gap(frame.size);
        },
        [&](std::size_t bytes) { reader.gap(bytes); });
    if (reader.recording.runs.empty())
        throw InputError(what + "its header is " +
                         (reader.wrong_header.empty() ? "incomplete" : "wrong: " + reader.wrong_header));
    reader.recording.losses = losses_of(reader.recording);
    return std::move(reader.recording);
}

}  // namespace palpate
