#include "scenes/program/replay_run.h"

#include <cstdio>
#include <optional>

#include "meshes/input_error.h"
#include "scenes/program/interruption.h"
#include "scenes/run/carry_over.h"

namespace palpate {

namespace {

/// The first array that came out otherwise; a file of version 1 does not name those of released bodies.
std::optional<Difference> difference_of(const RecordedStep& step, std::size_t k, const Simulation& s) {
    const StepOutcome now = outcome_of(s);
    const std::vector<std::string> names = array_names(s);
    if (now.hashes == step.outcome.hashes && (!step.arrays || *step.arrays == names)) return {};
    Difference out{k, "", 0};
    for (std::size_t i = 0; i < now.forces.size(); ++i)
        out.force_N = std::max(out.force_N, norm(now.forces[i] - step.outcome.forces[i]));
    const std::vector<std::string>& recorded = step.arrays ? *step.arrays : names;
    for (std::size_t a = 0; a < std::max(names.size(), recorded.size()) && out.array.empty(); ++a) {
        if (a >= names.size() || a >= recorded.size() || names[a] != recorded[a])
            out.array = a < recorded.size() ? recorded[a] : names[a];
        else if (a >= step.outcome.hashes.size() || now.hashes[a] != step.outcome.hashes[a])
            out.array = names[a];
    }
    return out;
}

/// Goes on with other settings, as the view did.
void change_settings(const RecordedRun& run, const RecordedRun::Change& change, const std::filesystem::path& file,
                     int threads, std::unique_ptr<Simulation>& simulation) {
    auto fresh = std::make_unique<Simulation>(make_simulation(recorded_scene(run, file, change.overrides), threads));
    if (!carry_over(*simulation, *fresh))
        throw InputError(file.string() + ": the scene with the settings of step " + std::to_string(change.step + 1) +
                         " is built otherwise than the recorded one was");
    simulation = std::move(fresh);
}

}  // namespace

Replay replay_run(const RecordedRun& run, const std::filesystem::path& file, int threads, const std::atomic<bool>& stop,
                  const std::function<void(const Simulation&)>& after_step) {
    Replay out;
    std::optional<EndsAtOnce> loading(std::in_place);
    out.simulation = std::make_unique<Simulation>(make_simulation(recorded_scene(run, file, run.overrides), threads));
    loading.reset();
    if (array_names(*out.simulation) != run.arrays || out.simulation->world.shapes.size() != run.objects.size())
        throw InputError(file.string() + ": the scene builds other fingers or thimbles than the recorded run had");
    const std::size_t end = run.gaps.empty() ? run.steps.size() : run.gaps[0].step;
    auto change = run.changes.begin();
    for (; out.steps < end && !stop; ++out.steps) {
        for (; change != run.changes.end() && change->step <= out.steps; ++change)
            change_settings(run, *change, file, threads, out.simulation);
        advance(*out.simulation, run.steps[out.steps].inputs);
        if (after_step) after_step(*out.simulation);
        if (!out.difference) out.difference = difference_of(run.steps[out.steps], out.steps, *out.simulation);
    }
    return out;
}

bool report_losses(const Recording& recording, const std::filesystem::path& file) {
    for (const std::string& loss : recording.losses) std::printf("%s: %s\n", file.c_str(), loss.c_str());
    return !recording.losses.empty();
}

std::filesystem::path folder_of_run(const std::filesystem::path& base, const Recording& recording, std::size_t run) {
    if (recording.runs.size() == 1) return base;
    char name[32];
    std::snprintf(name, sizeof name, "run_%04zu", run + 1);
    return base / name;
}

}  // namespace palpate
