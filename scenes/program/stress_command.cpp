// `palpate stress`: the extremes, survived or not.

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <thread>

#include "scenes/program/commands.h"
#include "scenes/program/progress.h"
#include "scenes/studies/random/random_trials.h"
#include "scenes/studies/stress/stress.h"

namespace palpate {

namespace {

int try_random(RandomTrials trials, bool json, const std::atomic<bool>& stop) {
    std::filesystem::create_directories(trials.folder);
    int tried = 0, failed = 0, refused = 0;
    std::vector<unsigned> several;
    nlohmann::json broken = nlohmann::json::array();
    Progress progress("stress");
    try_random_scenes(trials, stop, [&](const RandomTrial& t) {
        progress.show(double(++tried) / trials.count);
        refused += t.refused;
        if (t.several_answers) several.push_back(t.seed);
        if (t.violations.empty()) return;
        ++failed;
        for (const Violation& v : t.violations)
            broken.push_back({{"seed", t.seed}, {"law", v.law}, {"found", v.found}, {"file", t.file.string()}});
        if (json) return;
        progress.clear();
        for (const Violation& v : t.violations)
            std::printf("seed %u: %s: %s\n", t.seed, v.law.c_str(), v.found.c_str());
        std::printf("         %s\n", t.file.c_str());
        std::fflush(stdout);
    });
    progress.clear();
    if (json) {
        const nlohmann::json all{{"scenes", tried},
                                 {"refused", refused},
                                 {"several_answers", several},
                                 {"broke_a_law", failed},
                                 {"first_seed", trials.first_seed},
                                 {"violations", broken}};
        std::printf("%s\n", all.dump(2).c_str());
    } else {
        std::printf("%d random scenes, %d broke a law", tried, failed);
        if (refused > 0) std::printf(", %d were refused: a body would begin inside a finger", refused);
        if (!several.empty()) std::printf(", %zu had more than one answer (seed", several.size());
        for (const unsigned seed : several) std::printf(" %u", seed);
        if (!several.empty()) std::printf(")");
        std::printf(" (seeds %d to %d)\n", trials.first_seed, trials.first_seed + std::max(tried, 1) - 1);
    }
    return stop ? 130 : failed ? 1 : 0;
}

int try_cases(const std::vector<std::string>& only, bool brief, bool json, const std::atomic<bool>& stop) {
    std::vector<const StressCase*> wanted;
    for (const StressCase& s : stress_cases())
        if (only.empty() || std::find(only.begin(), only.end(), s.name) != only.end()) wanted.push_back(&s);
    int failed = 0;
    nlohmann::json all = nlohmann::json::array();
    Progress progress("stress");
    for (const StressCase* s : wanted) {
        if (stop) break;
        const auto start = std::chrono::steady_clock::now();
        const StressOutcome o = s->run(brief ? 1 : 10, stop);
        const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
        failed += !o.passed;
        all.push_back({{"case", s->name},
                       {"passed", o.passed},
                       {"extreme", s->extreme},
                       {"criterion", s->criterion},
                       {"found", o.found},
                       {"seconds", seconds}});
        if (!json) {
            progress.clear();
            std::printf("%-4s %-6s %s\n            asked: %s\n            found: %s (%.1f s)\n", s->name.c_str(),
                        o.passed ? "pass" : "FAIL", s->extreme.c_str(), s->criterion.c_str(), o.found.c_str(), seconds);
            std::fflush(stdout);
        }
        if (s != wanted.back()) progress.show(double(all.size()) / double(wanted.size()));
    }
    progress.clear();
    if (json) std::printf("%s\n", all.dump(2).c_str());
    return stop ? 130 : failed ? 1 : 0;
}

}  // namespace

Action add_stress_command(const Command& program, const std::atomic<bool>& stop) {
    const Command c = program.subcommand("stress", "try the extremes, and say what came of it");
    auto brief = std::make_shared<bool>(false);
    auto only = std::make_shared<std::vector<std::string>>();
    std::vector<std::string> names;
    for (const StressCase& s : stress_cases()) names.push_back(s.name);
    c.flag("--short", *brief, "a minute instead of an hour");
    c.option("--case", *only, "only these, for example S1,S6").comma_separated().among(names);
    auto random = std::make_shared<RandomTrials>();
    random->count = 0;
    random->processes = std::max(1, int(std::thread::hardware_concurrency()));
    auto folder = std::make_shared<std::string>("results/random");
    auto as_found = std::make_shared<bool>(false);
    c.option("--random", random->count, "instead: this many random scenes against laws that hold in every scene")
        .range(1, 100000000);
    c.option("--seed", random->first_seed, "seed of the first random scene; the others follow");
    c.option("--processes", random->processes, "random scenes tried at once (default: all cores)").range(1, 1024);
    c.option("--out", *folder, "folder of random scenes that break a law (default: results/random)");
    c.option("--compared-every", random->compared_every,
             "compare only every so many-th random scene with other runs of it; what a single run shows is always "
             "looked at")
        .range(1, 1000000);
    c.flag("--no-shrink", *as_found, "leave them as they are instead of making them small");
    c.flag("--thorough", random->thorough,
           "compare each random scene with all other runs of it, however long they take");
    auto json = std::make_shared<bool>(false);
    c.flag("--json", *json, "print what came of it as JSON");
    return [brief, only, random, folder, as_found, json, &stop] {
        random->folder = *folder;
        random->shrink = !*as_found;
        return random->count > 0 ? try_random(*random, *json, stop) : try_cases(*only, *brief, *json, stop);
    };
}

}  // namespace palpate
