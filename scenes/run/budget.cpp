#include "scenes/run/budget.h"

#include <unistd.h>

#include <algorithm>
#include <fstream>
#include <functional>
#include <sstream>

#include "meshes/mesh_cache.h"
#include "meshes/mesh_files.h"
#include "scenes/load/presets.h"
#include "scenes/run/simulation.h"

namespace palpate {

namespace {

/// Everything that a step's time depends on, as one number; the program itself by size and time of its file.
std::string key_of(const std::filesystem::path& scene, const std::vector<std::string>& overrides,
                   const std::string& preset, int threads) {
    std::ostringstream text;
    text << std::filesystem::absolute(scene).string() << "\n" << read_file(scene) << "\n";
    for (const std::string& o : overrides) text << o << "\n";
    text << preset << "\n" << threads << "\n" << processor() << "\n";
    std::error_code error;
    const std::filesystem::path program = std::filesystem::read_symlink("/proc/self/exe", error);
    text << std::filesystem::file_size(program, error) << "\n"
         << std::filesystem::last_write_time(program, error).time_since_epoch().count();
    std::ostringstream key;
    key << std::hex << std::hash<std::string>{}(text.str());
    return key.str();
}

double measure_p99_ms(const std::filesystem::path& scene, const std::vector<std::string>& overrides, int threads,
                      const std::atomic<bool>& stop, const std::function<void(double)>& progress) {
    Simulation s = make_simulation(load_scene(scene, overrides), threads);
    s.governor.reset();
    s.scene.duration = std::min(s.scene.duration, std::max(1.0, 0.5 * s.scene.duration));
    run(s, stop, [&](const StepInputs&, double share) { progress(share); });
    auto total = s.step_series.column("total_us");
    std::sort(total.begin(), total.end());
    return total.empty() ? 0 : 1e-3 * total[std::size_t(0.99 * double(total.size() - 1))];
}

}  // namespace

std::string processor() {
    std::ifstream in("/proc/cpuinfo");
    for (std::string line; std::getline(in, line);)
        if (line.starts_with("model name")) return line.substr(line.find(':') + 2);
    return "unknown processor";
}

BudgetChoice preset_within(double budget_ms, const std::filesystem::path& scene,
                           const std::vector<std::string>& overrides, int threads, const std::atomic<bool>& stop,
                           const std::function<void(double)>& progress) {
    BudgetChoice choice;
    const std::filesystem::path folder = cache_folder();
    for (auto preset = preset_names().rbegin(); preset != preset_names().rend() && !stop; ++preset) {
        PresetTime time{*preset};
        const std::filesystem::path file =
            folder.empty() ? folder : folder / (key_of(scene, overrides, *preset, threads) + ".p99_ms");
        std::ifstream kept(file);
        time.cached = !file.empty() && kept >> time.p99_ms && time.p99_ms > 0;
        if (!time.cached) {
            std::vector<std::string> tried = overrides;
            tried.push_back("solver.preset=" + *preset);
            time.p99_ms = measure_p99_ms(scene, tried, threads, stop, [&](double share) {
                if (progress) progress((double(choice.tried.size()) + share) / double(preset_names().size()));
            });
            // A calibration that cannot be kept is made again next time.
            std::error_code error;
            std::filesystem::create_directories(folder, error);
            if (!error && !file.empty() && !stop) std::ofstream(file) << time.p99_ms << "\n";
        }
        choice.tried.push_back(time);
        if (time.p99_ms > budget_ms) continue;
        choice.preset = *preset;
        return choice;
    }
    return choice;
}

}  // namespace palpate
