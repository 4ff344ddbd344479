#pragma once
// Thousands of random scenes against the laws, each in a process of its own: a crash or a hang is a finding, too.

#include <atomic>
#include <filesystem>
#include <functional>

#include "scenes/studies/random/laws.h"

namespace palpate {

struct RandomTrial {
    unsigned seed = 0;
    std::vector<Violation> violations;
    bool refused = false;          ///< it was drawn with a body inside a finger, which is no scene: nothing was tried
    bool several_answers = false;  ///< comparisons between its runs say nothing: see laws.h
    std::filesystem::path file;    ///< the smallest scene found that breaks the first of them; empty without any
};

struct RandomTrials {
    int first_seed = 1;
    int count = 100;
    bool shrink = true;
    double time_limit = 120;  ///< of one scene: processor time [s]
    int processes = 1;        ///< at once
    int compared_every = 1;   ///< only each so many-th seed is compared with other runs
    bool thorough = false;  ///< every scene is compared with all other runs of it; else with some, the cheaper the more
    std::filesystem::path folder = ".";  ///< of scenes that break a law: random-SEED.toml
};

/// Tries them all, or until `stop`. Calls after_each for every scene in order of seeds.
void try_random_scenes(const RandomTrials& trials, const std::atomic<bool>& stop,
                       const std::function<void(const RandomTrial&)>& after_each);

}  // namespace palpate
