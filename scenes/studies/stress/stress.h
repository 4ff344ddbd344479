#pragma once
// The extremes: what must not break, tried on purpose. Each case says what was asked, and what came of it.

#include <atomic>
#include <functional>
#include <string>
#include <vector>

namespace palpate {

struct StressOutcome {
    bool passed = false;
    std::string found;  ///< figures, and where it failed the worst case
};

struct StressCase {
    std::string name, extreme, criterion;
    /// `effort`: 1 = a few seconds each; 10 and more = the whole of it.
    std::function<StressOutcome(int effort, const std::atomic<bool>& stop)> run;
};

const std::vector<StressCase>& stress_cases();

}  // namespace palpate
