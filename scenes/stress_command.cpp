// `palpate stress`: the extremes, survived or not.

#include <chrono>
#include <cstdio>

#include "scenes/commands.h"
#include "scenes/stress/stress.h"

namespace palpate {

Action add_stress_command(CLI::App& program, const std::atomic<bool>& stop) {
    auto* c = program.add_subcommand("stress", "try the extremes, and say what came of it");
    auto effort = std::make_shared<int>(10);
    auto only = std::make_shared<std::vector<std::string>>();
    std::vector<std::string> names;
    for (const StressCase& s : stress_cases()) names.push_back(s.name);
    c->add_flag_callback(
        "--short", [effort] { *effort = 1; }, "a minute instead of half an hour");
    c->add_option("--case", *only, "only these, for example S1,S6")->delimiter(',')->check(CLI::IsMember(names));
    return [effort, only, &stop] {
        int failed = 0;
        for (const StressCase& s : stress_cases()) {
            if (stop) break;
            if (!only->empty() && std::find(only->begin(), only->end(), s.name) == only->end()) continue;
            const auto start = std::chrono::steady_clock::now();
            const StressOutcome o = s.run(*effort, stop);
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
