#pragma once
// How far a command is: a line on a terminal, nothing elsewhere.

#include <chrono>
#include <cstdint>
#include <string>

namespace palpate {

/// What the line says: a bar, the share that is done, speed where time is simulated, what remains. 79 columns at most.
std::string progress_line(const std::string& what, double share, double elapsed_s, std::int64_t steps,
                          double simulated_s);

/// Shows nothing in the first second, and then ten times a second at most.
class Progress {
  public:
    explicit Progress(std::string what, bool quiet = false);
    ~Progress() { clear(); }
    /// Share done; steps and seconds simulated, where there are any.
    void show(double share, std::int64_t steps = 0, double simulated_s = 0);
    /// Takes the line away, so that something else can be printed.
    void clear();

  private:
    using Clock = std::chrono::steady_clock;
    std::string what_;
    bool on_, shown_ = false;
    Clock::time_point begun_, next_;
};

}  // namespace palpate
