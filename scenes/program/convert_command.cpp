// `palpate convert`: recorded runs as tables (CSV, HDF5), and as pads over time for ParaView (VTU).

#include <cstdio>
#include <map>

#include "meshes/input_error.h"
#include "scenes/program/commands.h"
#include "scenes/program/progress.h"
#include "scenes/program/replay_run.h"
#include "scenes/recording/hdf5_file.h"
#include "scenes/recording/outputs.h"
#include "scenes/recording/results.h"
#include "scenes/recording/results_folder.h"

namespace palpate {

namespace {

struct ConvertArguments {
    std::string file, csv, hdf5, vtu;
    double rate = 30;
    int threads = 0;
};

void add_pose(std::vector<double>& row, const Pose<double>& p) {
    for (double v : {1e3 * p.position.x, 1e3 * p.position.y, 1e3 * p.position.z, p.rotation.w, p.rotation.x,
                     p.rotation.y, p.rotation.z})
        row.push_back(v);
}

/// What went in and what forces came out, per finger and object; `prefix` leads the names.
void add_tables(const RecordedRun& run, const std::string& prefix, std::map<std::string, Series>& tables) {
    for (std::size_t f = 0; f < run.fingers.size(); ++f) {
        Series& s = tables[prefix + "fingers/" + run.fingers[f]];
        s.columns = {"time_s", "tracked", "sample_time_s", "x_mm",      "y_mm",     "z_mm", "qw", "qx",
                     "qy",     "qz",      "force_x_N",     "force_y_N", "force_z_N"};
        s.reserve(run.steps.size());
        for (const RecordedStep& step : run.steps) {
            const TrackerPose::Sample& in = step.inputs.fingers[f];
            for (double v : {step.time, double(in.valid), in.time}) s.values.push_back(v);
            add_pose(s.values, in.pose);
            const Vec3<double>& force = step.outcome.forces[f];
            for (double v : {force.x, force.y, force.z}) s.values.push_back(v);
        }
    }
    for (std::size_t o = 0; o < run.objects.size(); ++o) {
        Series& s = tables[prefix + "objects/" + run.objects[o]];
        s.columns = {"time_s", "x_mm", "y_mm", "z_mm", "qw", "qx", "qy", "qz"};
        s.reserve(run.steps.size());
        for (const RecordedStep& step : run.steps) {
            const Pose<double>* pose = &step.inputs.objects[o];
            for (const MovedObject& m : step.outcome.moved)
                if (m.object == int(o)) pose = &m.pose;
            s.values.push_back(step.time);
            add_pose(s.values, *pose);
        }
    }
}

/// What a run was: its scene, and the settings that were laid over it.
void add_notes(const RecordedRun& run, const std::string& prefix, std::map<std::string, std::string>& notes) {
    const auto lines = [](const std::vector<std::string>& all) {
        std::string text;
        for (const std::string& line : all) text += (text.empty() ? "" : "\n") + line;
        return text;
    };
    notes[prefix + "scene"] = run.scene;
    notes[prefix + "scene_text"] = run.text;
    notes[prefix + "settings"] = lines(run.overrides);
    for (const RecordedRun::Change& change : run.changes)
        notes[prefix + "settings_after_step_" + std::to_string(change.step)] = lines(change.overrides);
}

/// The folders that are written into; both kinds of output may go to the same one.
struct Folders {
    std::map<std::filesystem::path, ResultsFolder> open{};
    ResultsFolder& at(const std::string& folder) {
        return open.try_emplace(std::filesystem::weakly_canonical(folder), folder).first->second;
    }
    void finish() {
        for (auto& [path, results] : open)
            for (const std::string& sentence : results.finish())
                std::printf("%s: %s\n", path.c_str(), sentence.c_str());
    }
};

void write_tables(const std::filesystem::path& folder, const std::map<std::string, Series>& tables) {
    for (const auto& [name, series] : tables) {
        const std::filesystem::path path = folder / (name + ".csv");
        std::filesystem::create_directories(path.parent_path());
        write_csv(path, series);
    }
}

/// Pads are not in the file: they come from running it again. False where other bits come out.
bool write_pads(const ConvertArguments& a, const std::filesystem::path& folder, const Recording& recording,
                const std::atomic<bool>& stop) {
    bool same = true;
    for (std::size_t k = 0; k < recording.runs.size() && !stop; ++k) {
        const std::filesystem::path run = folder_of_run(folder, recording, k);
        std::filesystem::create_directories(run);
        PadSeries pads(run, a.rate);
        Progress progress("convert");
        const double steps = double(std::max<std::size_t>(1, recording.runs[k].steps.size()));
        const Replay replay = replay_run(recording.runs[k], a.file, a.threads, stop, [&](const Simulation& s) {
            pads.record(s);
            progress.show(double(s.world.step) / steps, s.world.step, s.world.time);
        });
        pads.finish(*replay.simulation);
        same &= !replay.difference;
    }
    return same;
}

int convert(const ConvertArguments& a, const std::atomic<bool>& stop) {
    if (a.csv.empty() && a.hdf5.empty() && a.vtu.empty())
        throw InputError("convert: say to what: --csv FOLDER, --hdf5 FILE or --vtu FOLDER");
    refuse_to_replace("--hdf5", a.hdf5, Output::hdf5);
    if (!a.hdf5.empty() && !has_hdf5()) write_hdf5(a.hdf5, {});
    const Recording recording = read_recording(a.file);
    std::map<std::string, Series> tables;
    std::map<std::string, std::string> notes;
    std::size_t steps = 0;
    for (std::size_t k = 0; k < recording.runs.size(); ++k) {
        const std::string run = folder_of_run("", recording, k).string();
        add_tables(recording.runs[k], run.empty() ? "" : run + "/", tables);
        if (!recording.runs[k].fingers.empty()) add_notes(recording.runs[k], run.empty() ? "" : run + "/", notes);
        steps += recording.runs[k].steps.size();
    }
    Folders folders;
    if (!a.csv.empty()) write_tables(folders.at(a.csv).part(), tables);
    if (!a.hdf5.empty()) write_hdf5(a.hdf5, tables, notes);
    const bool same = a.vtu.empty() || write_pads(a, folders.at(a.vtu).part(), recording, stop);
    folders.finish();
    for (const std::string& out : {a.csv, a.hdf5})
        if (!out.empty()) std::printf("%zu tables of %zu steps in %s\n", tables.size(), steps, out.c_str());
    if (!a.vtu.empty())
        std::printf("pads over time in %s%s\n", a.vtu.c_str(),
                    same ? "" : "; they are not those of the recorded run: this program computes other bits");
    const bool lost = report_losses(recording, a.file);
    return stop ? 130 : same && !lost ? 0 : 1;
}

}  // namespace

Action add_convert_command(const Command& program, const std::atomic<bool>& stop) {
    const Command c = program.subcommand("convert", "recorded runs as tables (CSV, HDF5) or pads over time (VTU)");
    auto a = std::make_shared<ConvertArguments>();
    c.option("file", a->file, "what `palpate run --record` or `palpate view --record` wrote").required();
    c.option("--csv", a->csv, "folder for tables: tracked poses and contact forces per finger, poses per object");
    c.option("--hdf5", a->hdf5, "the same tables in one HDF5 file");
    c.option("--vtu", a->vtu, "folder for pads over time, for ParaView: runs the scene again");
    c.option("--rate", a->rate, "pads per second (default: 30)").range(1e-3, 1e5);
    c.option("--threads", a->threads, "threads (default: all cores)").range(1, 1024);
    return [a, &stop] { return convert(*a, stop); };
}

}  // namespace palpate
