#include "scenes/studies/random/random_trials.h"

#include <poll.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstring>
#include <deque>
#include <fstream>

#include "meshes/input_error.h"
#include "scenes/load/scene.h"
#include "scenes/studies/random/shrink.h"

namespace palpate {

namespace {

/// Newton iterations of other runs of a scene, after which it is compared with no more of them: most scenes are through
/// with all by then; the few that take ten times as long are not the ones that find ten times as much. Of short ones
/// another thousand is as cheap as all comparisons of one.
double comparisons_at_most(unsigned seed) { return is_short_scene(seed) ? 300 : 3000; }

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

/// A scene that is held against the laws in a process of its own, in a folder of its own.
struct Judging {
    std::filesystem::path folder;
    pid_t child = -1;
    int in = -1;  ///< what it writes; -1: it has ended
    std::chrono::steady_clock::time_point deadline;
    double time_limit = 0;
    std::string text;
    std::vector<Violation> found;  ///< once it has ended
};

std::filesystem::path scene_in(const std::filesystem::path& folder) { return folder / "scene.toml"; }

/// Begins in a process of its own. No thread has been started before it is forked.
Judging begin_judging(const RandomScene& scene, const std::filesystem::path& folder, FingerTemplates& templates,
                      const LawBudget& budget, double time_limit) {
    std::filesystem::create_directories(folder);
    std::ofstream(scene_in(folder)) << to_text(scene);
    if (!scene.mesh.empty()) std::ofstream(folder / random_mesh_file) << scene.mesh;
    int ends[2];
    if (::pipe(ends) != 0) throw std::runtime_error(std::string("pipe: ") + std::strerror(errno));
    Judging j{folder, ::fork(), ends[0], {}, time_limit, {}, {}};
    if (j.child < 0) throw std::runtime_error(std::string("fork: ") + std::strerror(errno));
    if (j.child == 0) {
        ::close(ends[0]);
        limit_processor_time(time_limit);
        report_and_leave(scene_in(folder), templates, budget, ends[1]);
    }
    ::close(ends[1]);
    j.deadline = std::chrono::steady_clock::now() + std::chrono::seconds(10 * std::int64_t(std::ceil(time_limit)));
    return j;
}

/// Its process has ended, or is ended now: what it has found.
void end_judging(Judging& j, bool closed) {
    ::close(j.in);
    j.in = -1;
    if (!closed) ::kill(j.child, SIGKILL);
    int status = 0;
    while (::waitpid(j.child, &status, 0) < 0 && errno == EINTR) {}
    std::filesystem::remove_all(j.folder);
    j.found = parse(j.text);
    const bool ended = closed && !(WIFSIGNALED(status) && WTERMSIG(status) == SIGXCPU);
    if (!ended)
        j.found.push_back({"every step ends", "no end within " + std::to_string(int(j.time_limit)) +
                                                  " s of processor time" +
                                                  (closed ? "" : ", nor within ten times that by the clock")});
    if (ended && WIFSIGNALED(status))
        j.found.push_back({"nothing crashes", std::string("ended by ") + strsignal(WTERMSIG(status))});
}

/// Waits until one of them, which have not all ended, writes, ends, or takes too long.
void wait_for_any(std::vector<Judging*> all) {
    std::erase_if(all, [](const Judging* j) { return j->in < 0; });
    std::vector<pollfd> ends;
    auto deadline = std::chrono::steady_clock::time_point::max();
    for (const Judging* j : all) ends.push_back({j->in, POLLIN, 0}), deadline = std::min(deadline, j->deadline);
    const auto left = std::chrono::ceil<std::chrono::milliseconds>(deadline - std::chrono::steady_clock::now());
    ::poll(ends.data(), ends.size(), int(std::max<std::int64_t>(0, left.count())));
    for (std::size_t i = 0; i < all.size(); ++i) {
        Judging& j = *all[i];
        if (ends[i].revents == 0) {
            if (std::chrono::steady_clock::now() >= j.deadline) end_judging(j, false);
            continue;
        }
        char buffer[4096];
        const ssize_t n = ::read(j.in, buffer, sizeof buffer);
        if (n > 0) j.text.append(buffer, std::size_t(n));
        if (n == 0 || (n < 0 && errno != EINTR)) end_judging(j, true);
    }
}

/// Meshes that random scenes are made of: built once, processes inherit them.
FingerTemplates random_scene_meshes(const RandomTrials& t) {
    FingerTemplates templates;
    bool other = false;
    for (int k = 0; k < std::min(t.count, 10); ++k) other |= has_other_fingers(unsigned(t.first_seed + k));
    const std::filesystem::path file = t.folder / "random-fingers.toml";
    for (const bool uniform : {true, false}) {
        if (!has_fingers(unsigned(t.first_seed), uniform)) continue;
        std::ofstream(file) << to_text(random_scene_fingers(other, uniform));
        load_scene(file, {}, &templates);
    }
    std::filesystem::remove(file);
    return templates;
}

bool breaks(const std::vector<Violation>& violations, const std::string& law) {
    return std::any_of(violations.begin(), violations.end(), [&](auto& v) { return v.law == law; });
}

/// Load refuses bodies that begin inside a finger or deep in each other, and fingers that begin deep inside objects
/// (start_overlap.h), and where one has been drawn so it has to.
bool is_refusal_of_overlap(const Violation& v) {
    auto says = [&](const char* part) { return v.found.find(part) != std::string::npos; };
    return v.law == "scenes load" &&
           (says("starts inside finger") || says("deeper than half its thickness") || says("would be thrown apart"));
}

/// Makes a scene small that breaks a law, and writes it beside the others: random-SEED.toml, and its mesh.
void keep(RandomTrial& trial, RandomScene scene, const RandomTrials& t, FingerTemplates& templates,
          const std::atomic<bool>& stop) {
    const std::string name = "random-" + std::to_string(trial.seed), law = trial.violations.front().law;
    const auto breaks_it = [&](const RandomScene& smaller) {
        if (stop) return false;
        Judging j = begin_judging(smaller, t.folder / (name + ".smaller"), templates, {}, t.time_limit);
        while (j.in >= 0) wait_for_any({&j});
        return breaks(j.found, law);
    };
    if (t.shrink) scene = shrink_scene(scene, breaks_it);
    if (!scene.mesh.empty()) {
        std::ofstream(t.folder / (name + ".obj")) << scene.mesh;
        for (auto& block : scene.blocks)
            for (std::string& l : block)
                if (const auto at = l.find(random_mesh_file); at != std::string::npos)
                    l.replace(at, std::strlen(random_mesh_file), name + ".obj");
    }
    trial.file = t.folder / (name + ".toml");
    std::ofstream(trial.file) << "# seed " << trial.seed << ": " << law << "\n# " << trial.violations.front().found
                              << "\n"
                              << to_text(scene);
}

}  // namespace

void try_random_scenes(const RandomTrials& t, const std::atomic<bool>& stop,
                       const std::function<void(const RandomTrial&)>& after_each) {
    FingerTemplates templates = random_scene_meshes(t);
    std::deque<Judging> judged;  // in order of seeds, the first of which is told next
    int begun = 0, told = 0;
    const auto seed_of = [&](int k) { return unsigned(t.first_seed + k); };
    while (told < t.count && !stop) {
        const auto running = std::count_if(judged.begin(), judged.end(), [](auto& j) { return j.in >= 0; });
        // One that takes long holds no process back, but for a while only: what is found is told in order.
        if (begun < t.count && running < t.processes && int(judged.size()) < 50 * t.processes) {
            const unsigned seed = seed_of(begun++);
            LawBudget budget{seed, comparisons_at_most(seed)};
            if (seed % unsigned(t.compared_every) != 0) budget.iterations = 0;
            if (t.thorough) budget = {};
            judged.push_back(begin_judging(random_scene(seed), t.folder / ("random-" + std::to_string(seed) + ".tried"),
                                           templates, budget, t.time_limit));
            continue;
        }
        if (judged.front().in >= 0) {
            std::vector<Judging*> all;
            for (Judging& j : judged) all.push_back(&j);
            wait_for_any(all);
            continue;
        }
        RandomTrial trial{seed_of(told++), std::move(judged.front().found), false, false, {}};
        judged.pop_front();
        trial.several_answers =
            std::erase_if(trial.violations, [](const Violation& v) { return v.law == several_answers; }) > 0;
        trial.refused = trial.violations.size() == 1 && is_refusal_of_overlap(trial.violations.front());
        if (trial.refused) trial.violations.clear();
        if (!trial.violations.empty()) keep(trial, random_scene(trial.seed), t, templates, stop);
        after_each(trial);
    }
    for (Judging& j : judged)
        if (j.in >= 0) end_judging(j, false);
}

}  // namespace palpate
