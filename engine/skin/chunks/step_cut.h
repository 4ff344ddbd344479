#pragma once
// Where a solve stops before it is done, so that a step is in time.

#include <chrono>

namespace palpate {

/// Of one solve. An iteration that has begun is ended, line search included, and so is one that follows an update of
/// multipliers; every finger gets one, and what is far from balance is solved on as without a deadline. What is left is
/// the last accepted iterate, balanced less well, which its status says. A step depends on the clock so; by which pass
/// it was cut tells how to repeat it.
struct StepCut {
    using Time = std::chrono::steady_clock::time_point;
    Time until = Time::max();
    int given = -1;  ///< cut at this pass of the iteration instead: a recorded step's; -1: by the clock
    int at = -1;     ///< pass at which it was cut; -1: it was not
    Time last{};     ///< when the pass before began
    std::chrono::steady_clock::duration longest{0};  ///< of the passes so far

    void begin(Time deadline, int recorded) { until = deadline, given = recorded, at = -1, longest = {}; }
    /// Whether no iteration is to begin in this pass (0, 1, ...): it would not end in time if it took as long as the
    /// longest so far. Asks the clock only where there is a deadline.
    bool is_late(int pass);
};

}  // namespace palpate
