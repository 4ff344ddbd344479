#pragma once
// What fingers feel, told to other programs while a scene runs, and poses from them: a line of JSON a step
// (stream_message.h), to standard output, as datagrams of UDP, or as messages of WebSockets, whose answers are
// commands. The step hands numbers over and goes on; a thread of its own writes and sends them. Where that, or whoever
// reads, is slower than the steps, steps are left out, but never the last one.

#include <cstdint>
#include <memory>
#include <string>

#include "scenes/run/simulation.h"
#include "scenes/stream/stream_settings.h"

namespace palpate {

struct StreamCounts {
    std::int64_t told = 0;      ///< steps
    std::int64_t sent = 0;      ///< lines
    std::int64_t left_out = 0;  ///< steps, because writing took longer
    std::int64_t missed = 0;    ///< lines that WebSockets did not get, because they read too slowly
    std::int64_t commands = 0, wrong_commands = 0;
    bool cut = false;  ///< whoever reads standard output has gone, or it cannot be written
    int error = 0;     ///< of the latter, errno
};

/// In a line, for a person.
std::string to_text(const StreamCounts& counts);

class Stream {
  public:
    /// Throws InputError where there is no such target.
    explicit Stream(const StreamSettings& settings);
    /// As `end`.
    ~Stream();
    Stream(const Stream&) = delete;
    Stream& operator=(const Stream&) = delete;

    /// Call after every step. Does not wait.
    void tell(const Simulation& simulation);
    /// Puts poses that were commanded into the inputs of the next step. Does not wait.
    void command(const Simulation& simulation, StepInputs& inputs);
    /// Settings that were commanded since the last time ("key=value"). Does not wait.
    std::vector<std::string> take_settings();
    /// Where WebSockets connect; empty for other targets.
    std::string address() const;
    /// Whether somebody has asked to pause, or the first reader is awaited.
    bool paused() const;
    StreamCounts counts() const;
    /// Sends what is waiting, for half a second at most, or for five to WebSockets that go on reading. Nothing is told
    /// afterwards.
    StreamCounts end();

  private:
    struct Work;
    std::unique_ptr<Work> work_;
};

/// What commands ask for, before a step: poses in `inputs`; waits while it is paused.
void obey(Stream& stream, Simulation& simulation, StepInputs& inputs, const std::atomic<bool>& stop);

}  // namespace palpate
