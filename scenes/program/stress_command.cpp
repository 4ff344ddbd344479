// `palpate stress`: the extremes, survived or not.

#include <algorithm>
#include <chrono>
#include <cstdio>

#include "scenes/program/commands.h"
#include "scenes/program/progress.h"
#include "scenes/studies/random/random_trials.h"
#include "scenes/studies/stress/stress.h"

namespace palpate {

namespace {

int try_random(RandomTrials trials, const std::atomic<bool>& stop) {
    std::filesystem::create_directories(trials.folder);
    int tried = 0, failed = 0;
    Progress progress("stress");
    try_random_scenes(trials, stop, [&](const RandomTrial& t) {
        progress.show(double(++tried) / trials.count);
        if (t.violations.empty()) return;
        progress.clear();
        ++failed;
        for (const Violation& v : t.violations)
            std::printf("seed %u: %s: %s\n", t.seed, v.law.c_str(), v.found.c_str());
        std::printf("         %s\n", t.file.c_str());
        std::fflush(stdout);
    });
    progress.clear();
    std::printf("%d random scenes, %d broke a law (seeds %d to %d)\n", tried, failed, trials.first_seed,
                trials.first_seed + std::max(tried, 1) - 1);
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
    auto folder = std::make_shared<std::string>("results/random");
    auto as_found = std::make_shared<bool>(false);
    c.option("--random", random->count, "instead: this many random scenes against laws that hold in every scene")
        .range(1, 100000000);
    c.option("--seed", random->first_seed, "seed of the first random scene; the others follow");
    c.option("--out", *folder, "folder of random scenes that break a law (default: results/random)");
    c.flag("--no-shrink", *as_found, "leave them as they are instead of making them small");
    return [brief, only, random, folder, as_found, &stop] {
        random->folder = *folder;
        random->shrink = !*as_found;
        if (random->count > 0) return try_random(*random, stop);
        int failed = 0;
        for (const StressCase& s : stress_cases()) {
            if (stop) break;
            if (!only->empty() && std::find(only->begin(), only->end(), s.name) == only->end()) continue;
            const auto start = std::chrono::steady_clock::now();
            const StressOutcome o = s.run(*brief ? 1 : 10, stop);
            const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
            std::printf("%-4s %-6s %s\n            asked: %s\n            found: %s (%.1f s)\n", s.name.c_str(),
                        o.passed ? "pass" : "FAIL", s.extreme.c_str(), s.criterion.c_str(), o.found.c_str(), seconds);
            std::fflush(stdout);
            failed += !o.passed;
        }
        return stop ? 130 : failed ? 1 : 0;
    };
}

}  // namespace palpate
