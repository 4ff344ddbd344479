#pragma once
// A scene that runs for a page that shows it, and does what people ask for there.

#include <chrono>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "meshes/input_error.h"
#include "scenes/program/stream_options.h"
#include "scenes/recording/run_file.h"
#include "scenes/run/dead_man.h"
#include "scenes/stream/stream.h"
#include "scenes/trackers/hand_doubts.h"
#include "scenes/viewer/report.h"
#include "scenes/viewer/server.h"

namespace palpate {

struct ViewArguments {
    std::string scene;
    std::vector<std::string> overrides;
    int threads = 0, port = 8420;
    std::string tracker, record, hold;
    StreamSettings stream;
    bool any_address = false, arm = false, remote_arm = false, no_watchdog = false;
};

/// How far from real time a run is: simulated over passed time, smoothed over about two seconds.
struct Pace {
    using Clock = std::chrono::steady_clock;
    Clock::time_point since = Clock::now();
    double simulated = 0;  ///< since then [s]
    double factor = 0;     ///< 0: not known yet
    void begin() { since = Clock::now(), simulated = 0; }
    /// True, with a new factor, every half second.
    bool look() {
        const double passed = std::chrono::duration<double>(Clock::now() - since).count();
        if (passed < 0.5) return false;
        const double now = simulated / passed;
        factor = factor == 0 ? now : factor + 0.25 * (now - factor);
        begin();
        return true;
    }
};

/// A scene that runs again and again, at some speed, until it is told otherwise.
struct LiveView {
    const ViewArguments& arguments;
    ViewServer& server;
    std::shared_ptr<LiveHands> hands{};  ///< null: fingers follow the scene's recording
    std::vector<std::string> overrides = arguments.overrides;
    std::unique_ptr<Simulation> simulation{};
    std::unique_ptr<RenderedPadsThread> rendered_pads{};
    std::unique_ptr<DrawnHands> drawn_hands{};
    std::string holds_time{};  ///< the override by which presets step down to hold real time; empty: none
    std::string text{};        ///< of the scene file, as it was read last
    std::string model{};       ///< what the page has been told of it, as JSON
    std::unique_ptr<DeadMan> dead_man{};
    std::unique_ptr<RunWriter> record{};
    std::unique_ptr<Stream> stream{};
    DoubtTeller doubts{};
    std::string silent{}, faults{};  ///< fingers that the page was told of
    Pace pace{};
    bool paused = false, has_run = false, told_failure = false;
    int single_steps = 0;
    double speed = 1;

    /// Loads the scene, and begins it anew; or, where it can, goes on where the run is.
    void start(bool go_on = false);
    /// One step, recorded if asked for: a recording holds all runs, one after the other.
    void advance_live();
    void look_at_dead_man();
    std::string preset_now() const;
    /// Tells the page whose trackers are silent, so that their thimbles are led to rest, when that changes.
    void tell_silence();
    /// Says what is likely wrong with the hands that come, once each.
    void tell_doubts();
    /// Tells the page which preset runs, and how fast.
    void tell_pace();
    /// Tells the page which thimbles are in fault, when that changes.
    void tell_faults();
    /// Takes overrides over if the scene still loads with them, and says what is wrong if not.
    void set(const std::vector<std::string>& wanted);
    /// Nobody moves a thimble from afar unless that was asked for: what arms or re-arms comes from this machine.
    bool may_obey(const ViewCommand& command);
    void obey(const nlohmann::json& command);

  private:
    /// Hands, the recording and controllers of a run that begins.
    void open_outside();
    void arm();
    /// A person asks for it: faults are cleared, and what was disarmed since is armed again.
    void rearm();
    void tell_error(const InputError& error);
};

}  // namespace palpate
