#include "scenes/run/budget.h"

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <functional>
#include <sstream>

#include "meshes/mesh_cache.h"
#include "meshes/mesh_files.h"
#include "meshes/plain_numbers.h"
#include "scenes/load/presets.h"
#include "scenes/run/series.h"
#include "scenes/run/simulation.h"

namespace palpate {

namespace {

/// Everything that a step's time depends on, as one number; the program itself by size and time of its file.
std::string key_of(const std::filesystem::path& scene, const std::vector<std::string>& overrides,
                   const std::string& preset, int threads) {
    PlainText text;
    text << std::filesystem::absolute(scene).string() << "\n" << read_file(scene) << "\n";
    for (const std::string& o : overrides) text << o << "\n";
    text << preset << "\n" << threads << "\n" << processor() << "\n";
    std::error_code error;
    const std::filesystem::path program = std::filesystem::read_symlink("/proc/self/exe", error);
    text << std::filesystem::file_size(program, error) << "\n"
         << std::filesystem::last_write_time(program, error).time_since_epoch().count();
    PlainText key;
    key << std::hex << std::hash<std::string>{}(text.str());
    return key.str();
}

/// Measures a step's p99 [ms], and no longer than until more than a hundredth of all steps have exceeded the budget.
void measure(BudgetPoint& point, double budget_ms, const std::filesystem::path& scene,
             const std::vector<std::string>& overrides, int threads, const std::atomic<bool>& stop,
             const std::function<void(double)>& progress) {
    Simulation s = make_simulation(load_scene(scene, overrides), threads);
    s.governor.reset();
    s.scene.duration = std::min(s.scene.duration, std::max(1.0, 0.5 * s.scene.duration));
    const double steps = s.scene.duration / s.world.solver.dt;
    const auto& names = s.step_series.columns;
    const auto column = std::size_t(std::find(names.begin(), names.end(), "total_us") - names.begin());
    std::size_t late = 0;
    std::atomic<bool> enough{false};
    run(s, enough, [&](const StepInputs&, double share) {
        progress(share);
        if (s.step_series.rows() == 0) return;
        const double total = s.step_series.at(s.step_series.rows() - 1, column);
        late += 1e-3 * total > budget_ms;
        enough = stop || double(late) > 0.01 * steps + 1;
    });
    auto total = s.step_series.column("total_us");
    std::sort(total.begin(), total.end());
    point.exceeded = enough && !stop;
    if (total.empty()) return;
    const auto below = std::size_t(0.99 * double(total.size() - 1));
    point.p99_ms = point.exceeded ? budget_ms : 1e-3 * total[below];
}

/// What is kept of an earlier calibration: p99, or a time that it exceeds.
bool read_kept(const std::filesystem::path& file, double budget_ms, BudgetPoint& point) {
    std::ifstream in(file);
    in.imbue(std::locale::classic());
    double p99 = 0;
    std::string sign;
    if (file.empty() || !(in >> p99) || !(p99 > 0)) return false;
    in >> sign;
    if (sign == "exceeded" && p99 < budget_ms) return false;
    point.p99_ms = p99, point.exceeded = sign == "exceeded", point.cached = true;
    return true;
}

/// Whether the scene leaves it to us how large its fingers' meshes are.
bool meshes_are_free(const std::filesystem::path& scene, const std::vector<std::string>& overrides) {
    for (const std::string& o : overrides)
        if (o.find("elements") != std::string::npos) return false;
    const Scene loaded = load_scene(scene, overrides);
    return !loaded.finger_models.empty() &&
           std::all_of(loaded.finger_models.begin(), loaded.finger_models.end(), [](const FingerModel& m) {
               const FingerMeshRequest usual, &r = m.mesh;
               return r.source == FingerMeshRequest::Source::parametric &&
                      r.kind == FingerMeshRequest::Kind::conforming &&
                      (r.elements == usual.elements || r.elements == usual_elements);
           });
}

/// How much longer steps take than with the cheapest, about.
double cost_of(const BudgetPoint& p) {
    const double presets[] = {1, 1.6, 3.5, 8};
    const auto& names = preset_names();
    const auto k = std::size_t(std::find(names.begin(), names.end(), p.preset) - names.begin());
    return presets[k] * (p.elements > 0 ? std::pow(p.elements / double(usual_elements), 1.4) : 1);
}

}  // namespace

std::string processor() {
    std::ifstream in("/proc/cpuinfo");
    for (std::string line; std::getline(in, line);)
        if (line.starts_with("model name")) return line.substr(line.find(':') + 2);
    return "unknown processor";
}

std::string name_of(const BudgetPoint& p) {
    return p.preset + (p.elements > 0 ? " with " + std::to_string(p.elements) + " tetrahedra a finger" : "");
}

std::vector<std::string> BudgetChoice::settings() const {
    std::vector<std::string> out{"solver.preset=" + chosen.preset};
    if (chosen.elements > 0) out.push_back("finger.*.elements=" + std::to_string(chosen.elements));
    return out;
}

std::vector<BudgetPoint> budget_points(bool meshes) {
    // Typical errors of the field at 5 ms, and of meshes against 5,600 tetrahedra (bench/README.md, "Presets",
    // "Meshes").
    const double of_preset[] = {0.08, 0.02, 0.01, 0.005};
    const std::pair<int, double> of_mesh[] = {{usual_elements, 0.08}, {700, 0.06}, {1400, 0.04}, {2800, 0.03}};
    std::vector<BudgetPoint> points;
    for (std::size_t k = 0; k < preset_names().size(); ++k) {
        if (!meshes) points.push_back({preset_names()[k], 0, of_preset[k]});
        for (const auto& [elements, error] : of_mesh)
            if (meshes) points.push_back({preset_names()[k], elements, std::hypot(of_preset[k], error)});
    }
    std::stable_sort(points.begin(), points.end(), [](auto& a, auto& b) { return a.error < b.error; });
    return points;
}

BudgetChoice choice_within(double budget_ms, const std::filesystem::path& scene,
                           const std::vector<std::string>& overrides, int threads, const std::atomic<bool>& stop,
                           const std::function<void(double)>& progress) {
    BudgetChoice choice;
    const std::filesystem::path folder = cache_folder();
    const std::vector<BudgetPoint> points = budget_points(meshes_are_free(scene, overrides));
    const auto try_out = [&](const BudgetPoint& p) {
        BudgetPoint point = p;
        BudgetChoice as_tried;
        as_tried.chosen = p;
        std::vector<std::string> settings = overrides;
        for (const std::string& o : as_tried.settings()) settings.push_back(o);
        const std::filesystem::path file =
            folder.empty() ? folder : folder / (key_of(scene, settings, p.preset, threads) + ".p99_ms");
        if (!read_kept(file, budget_ms, point)) {
            measure(point, budget_ms, scene, settings, threads, stop, [&](double share) {
                if (progress) progress((double(choice.tried.size()) + share) / double(points.size()));
            });
            // A calibration that cannot be kept is made again next time.
            std::error_code error;
            std::filesystem::create_directories(folder, error);
            if (!error && !file.empty() && !stop) {
                PlainText kept;
                kept << point.p99_ms << (point.exceeded ? " exceeded" : "") << "\n";
                std::ofstream(file) << kept.str();
            }
        }
        choice.tried.push_back(point);
        return point;
    };
    const auto keeps = [&](const BudgetPoint& p) { return !p.exceeded && p.p99_ms > 0 && p.p99_ms <= budget_ms; };
    const BudgetPoint& cheapest =
        *std::min_element(points.begin(), points.end(), [](auto& a, auto& b) { return cost_of(a) < cost_of(b); });
    const BudgetPoint base = try_out(cheapest);
    if (!keeps(base)) return choice;
    constexpr double hope = 2;  // costs are guessed within so much
    for (const BudgetPoint& p : points) {
        if (stop) break;
        if (p.preset == cheapest.preset && p.elements == cheapest.elements) continue;
        if (p.error > cheapest.error || cost_of(p) * base.p99_ms > hope * budget_ms) continue;
        const BudgetPoint tried = try_out(p);
        if (!keeps(tried)) continue;
        choice.found = true, choice.chosen = tried;
        return choice;
    }
    choice.found = true, choice.chosen = base;
    return choice;
}

}  // namespace palpate
