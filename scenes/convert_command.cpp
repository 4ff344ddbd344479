// `palpate convert`: a recorded run as tables (CSV, HDF5), and as pads over time for ParaView (VTU).

#include <cstdio>
#include <map>

#include "meshes/input_error.h"
#include "scenes/commands.h"
#include "scenes/recording/hdf5_file.h"
#include "scenes/recording/results.h"
#include "scenes/recording/run_file.h"

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

/// What went in and what forces came out, per finger and object.
std::map<std::string, Series> tables_of(const RecordedRun& run) {
    std::map<std::string, Series> tables;
    for (std::size_t f = 0; f < run.fingers.size(); ++f) {
        Series& s = tables["fingers/" + run.fingers[f]];
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
        Series& s = tables["objects/" + run.objects[o]];
        s.columns = {"time_s", "x_mm", "y_mm", "z_mm", "qw", "qx", "qy", "qz"};
        s.reserve(run.steps.size());
        for (const RecordedStep& step : run.steps) {
            s.values.push_back(step.time);
            add_pose(s.values, step.inputs.objects[o]);
        }
    }
    return tables;
}

/// Pads are not in the file: they come from running it again.
bool write_pads(const ConvertArguments& a, const RecordedRun& run, const std::atomic<bool>& stop) {
    Simulation s = make_simulation(recorded_scene(run, a.file), a.threads);
    std::filesystem::create_directories(a.vtu);
    PadSeries pads(a.vtu, a.rate);
    bool same = true;
    for (std::size_t k = 0; k < run.steps.size() && !stop; ++k) {
        advance(s, run.steps[k].inputs);
        pads.record(s);
        same &= outcome_of(s).hashes == run.steps[k].outcome.hashes;
    }
    pads.finish(s);
    return same;
}

int convert(const ConvertArguments& a, const std::atomic<bool>& stop) {
    if (a.csv.empty() && a.hdf5.empty() && a.vtu.empty())
        throw InputError("convert: say to what: --csv FOLDER, --hdf5 FILE or --vtu FOLDER");
    if (!a.hdf5.empty() && !has_hdf5()) write_hdf5(a.hdf5, {});
    const RecordedRun run = read_run(a.file);
    const std::map<std::string, Series> tables = tables_of(run);
    if (!a.csv.empty()) {
        for (const auto& [name, series] : tables) {
            const std::filesystem::path path = std::filesystem::path(a.csv) / (name + ".csv");
            std::filesystem::create_directories(path.parent_path());
            write_csv(path, series);
        }
        std::printf("%zu tables of %zu steps in %s\n", tables.size(), run.steps.size(), a.csv.c_str());
    }
    if (!a.hdf5.empty()) {
        write_hdf5(a.hdf5, tables);
        std::printf("%zu tables of %zu steps in %s\n", tables.size(), run.steps.size(), a.hdf5.c_str());
    }
    bool same = true;
    if (!a.vtu.empty()) {
        same = write_pads(a, run, stop);
        std::printf("pads over time in %s%s\n", a.vtu.c_str(),
                    same ? "" : "; they are not those of the recorded run: this program computes other bits");
    }
    if (run.unread_bytes > 0)
        std::printf("the last %zu bytes of the file are no complete frame: the recording was cut off there\n",
                    run.unread_bytes);
    return stop ? 130 : same ? 0 : 1;
}

}  // namespace

Action add_convert_command(CLI::App& program, const std::atomic<bool>& stop) {
    auto* c = program.add_subcommand("convert", "a recorded run as tables (CSV, HDF5) or pads over time (VTU)");
    auto a = std::make_shared<ConvertArguments>();
    c->add_option("file", a->file, "what `palpate run --record` wrote")->required();
    c->add_option("--csv", a->csv, "folder for tables: tracked poses and contact forces per finger, poses per object");
    c->add_option("--hdf5", a->hdf5, "the same tables in one HDF5 file");
    c->add_option("--vtu", a->vtu, "folder for pads over time, for ParaView: runs the scene again");
    c->add_option("--rate", a->rate, "pads per second (default: 30)")->check(CLI::Range(1e-3, 1e5));
    c->add_option("--threads", a->threads, "threads (default: all cores)")->check(CLI::Range(1, 1024));
    return [a, &stop] { return convert(*a, stop); };
}

}  // namespace palpate
