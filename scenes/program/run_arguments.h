#pragma once
// What `palpate run` is asked for, and doing it.

#include <atomic>
#include <string>
#include <vector>

#include "scenes/stream/stream_settings.h"

namespace palpate {

struct RunArguments {
    std::string scene, out, report, record, tracker, hold, video;
    StreamSettings stream;
    std::vector<std::string> overrides;
    int threads = 0;
    double duration = 0, pads_per_second = 0, budget_ms = 0;
    bool quiet = false, json = false, statics = false, arm = false, no_watchdog = false, no_hand = false,
         no_picture = false;
};

/// Loads the scene, runs it and writes what came of it. Returns the exit code. Throws InputError.
int run_scene(RunArguments a, const std::atomic<bool>& stop);

}  // namespace palpate
