#include "scenes/studies/random/random_trials.h"

#include <poll.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstring>
#include <fstream>

#include "meshes/input_error.h"
#include "scenes/load/scene.h"
#include "scenes/studies/random/shrink.h"

namespace palpate {

namespace {

/// Newton iterations of other runs of a scene, after which it is compared with no more of them: most scenes are through
/// with all by then; the few that take ten times as long are not the ones that find ten times as much.
constexpr double comparisons_at_most = 3000;

/// In the child: one line "law\tfound" per violation.
[[noreturn]] void report_and_leave(const std::filesystem::path& file, FingerTemplates& templates,
                                   const LawBudget& budget, int out) {
    std::string text;
    try {
        for (const Violation& v : broken_laws(file, &templates, budget)) text += v.law + "\t" + v.found + "\n";
    } catch (const InputError& error) {
        text = "scenes load\t" + error.messages.front() + "\n";
    } catch (const std::exception& error) { text = std::string("nothing is thrown\t") + error.what() + "\n"; }
    const char* p = text.data();
    for (std::size_t left = text.size(); left > 0;) {
        const ssize_t n = ::write(out, p, left);
        if (n <= 0) break;
        p += n, left -= std::size_t(n);
    }
    _exit(0);
}

/// Reads until the end or the deadline; false where it came first.
bool read_all(int in, double seconds, std::string& text) {
    const auto start = std::chrono::steady_clock::now();
    char buffer[4096];
    while (true) {
        const double left = seconds - std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
        pollfd p{in, POLLIN, 0};
        if (left <= 0 || (::poll(&p, 1, int(1e3 * left) + 1) == 0)) return false;
        const ssize_t n = ::read(in, buffer, sizeof buffer);
        if (n < 0 && errno == EINTR) continue;
        if (n <= 0) return true;
        text.append(buffer, std::size_t(n));
    }
}

std::vector<Violation> parse(const std::string& text) {
    std::vector<Violation> all;
    for (std::size_t begin = 0; begin < text.size();) {
        const std::size_t end = text.find('\n', begin), tab = text.find('\t', begin);
        if (end == std::string::npos || tab > end) break;
        all.push_back({text.substr(begin, tab - begin), text.substr(tab + 1, end - tab - 1)});
        begin = end + 1;
    }
    return all;
}

/// A busy machine is no hang: the limit is of processor time, ten times that where a process waits for something.
void limit_processor_time(double seconds) {
    const rlimit limit{rlim_t(seconds), rlim_t(seconds) + 1};
    ::setrlimit(RLIMIT_CPU, &limit);
}

/// The laws that a scene breaks, found out in a process of its own. No thread has been started before it is forked.
std::vector<Violation> judge(const RandomScene& scene, const std::filesystem::path& file, FingerTemplates& templates,
                             const LawBudget& budget, double time_limit) {
    std::ofstream(file) << to_text(scene);
    if (!scene.mesh.empty()) std::ofstream(file.parent_path() / random_mesh_file) << scene.mesh;
    int ends[2];
    if (::pipe(ends) != 0) throw std::runtime_error(std::string("pipe: ") + std::strerror(errno));
    const pid_t child = ::fork();
    if (child < 0) throw std::runtime_error(std::string("fork: ") + std::strerror(errno));
    if (child == 0) {
        ::close(ends[0]);
        limit_processor_time(time_limit);
        report_and_leave(file, templates, budget, ends[1]);
    }
    ::close(ends[1]);
    std::string text;
    const bool closed = read_all(ends[0], 10 * time_limit, text);
    ::close(ends[0]);
    if (!closed) ::kill(child, SIGKILL);
    int status = 0;
    while (::waitpid(child, &status, 0) < 0 && errno == EINTR) {}
    std::vector<Violation> all = parse(text);
    const bool ended = closed && !(WIFSIGNALED(status) && WTERMSIG(status) == SIGXCPU);
    if (!ended)
        all.push_back({"every step ends", "no end within " + std::to_string(int(time_limit)) + " s of processor time" +
                                              (closed ? "" : ", nor within ten times that by the clock")});
    if (ended && WIFSIGNALED(status))
        all.push_back({"nothing crashes", std::string("ended by ") + strsignal(WTERMSIG(status))});
    return all;
}

/// Meshes that random scenes are made of: built once, processes inherit them.
FingerTemplates random_scene_meshes(const std::filesystem::path& folder, bool other, bool uniform) {
    FingerTemplates templates;
    const std::filesystem::path file = folder / "random-fingers.toml";
    std::ofstream(file) << to_text(random_scene_fingers(other, uniform));
    load_scene(file, {}, &templates);
    std::filesystem::remove(file);
    return templates;
}

bool breaks(const std::vector<Violation>& violations, const std::string& law) {
    return std::any_of(violations.begin(), violations.end(), [&](auto& v) { return v.law == law; });
}

/// Load refuses bodies that begin inside a finger (start_overlap.h), and where one has been drawn so it has to.
bool is_refusal_of_overlap(const Violation& v) {
    return v.law == "scenes load" && v.found.find("starts inside finger") != std::string::npos;
}

}  // namespace

void try_random_scenes(const RandomTrials& t, const std::atomic<bool>& stop,
                       const std::function<void(const RandomTrial&)>& after_each) {
    bool other = false;
    for (int k = 0; k < std::min(t.count, 10); ++k) other |= has_other_fingers(unsigned(t.first_seed + k));
    FingerTemplates templates = random_scene_meshes(t.folder, other, unsigned(t.first_seed) < first_seed_of_conforming);
    for (int k = 0; k < t.count && !stop; ++k) {
        RandomTrial trial;
        trial.seed = unsigned(t.first_seed + k);
        const std::filesystem::path file = t.folder / ("random-" + std::to_string(trial.seed) + ".toml");
        RandomScene scene = random_scene(trial.seed);
        LawBudget budget{trial.seed, comparisons_at_most};
        if (t.thorough) budget = {};
        trial.violations = judge(scene, file, templates, budget, t.time_limit);
        trial.refused = trial.violations.size() == 1 && is_refusal_of_overlap(trial.violations.front());
        if (trial.refused) trial.violations.clear();
        if (stop) break;
        if (trial.violations.empty()) {
            std::filesystem::remove(file);
            if (!scene.mesh.empty()) std::filesystem::remove(t.folder / random_mesh_file);
        } else {
            const std::string law = trial.violations.front().law;
            if (t.shrink)
                scene = shrink_scene(scene, [&](const RandomScene& smaller) {
                    return !stop && breaks(judge(smaller, file, templates, {}, t.time_limit), law);
                });
            if (!scene.mesh.empty()) {  // beside the scene, under a name of its own
                const std::filesystem::path mesh = file.stem().string() + ".obj";
                std::filesystem::rename(t.folder / random_mesh_file, t.folder / mesh);
                for (auto& block : scene.blocks)
                    for (std::string& l : block)
                        if (const auto at = l.find(random_mesh_file); at != std::string::npos)
                            l.replace(at, std::strlen(random_mesh_file), mesh.string());
            }
            std::ofstream(file) << "# seed " << trial.seed << ": " << law << "\n# " << trial.violations.front().found
                                << "\n"
                                << to_text(scene);
            trial.file = file;
        }
        after_each(trial);
    }
}

}  // namespace palpate
