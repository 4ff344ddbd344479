#pragma once
// Whether good answers come: one of these per servo and direction.

#include <atomic>
#include <cstdint>

namespace palpate {

/// Counts what fails, and says when to give up: after two failures at least, with no good answer in between, for
/// answer_time. What goes well elsewhere changes nothing here.
class AnswerWatch {
  public:
    static constexpr double answer_time = 0.1;  ///< [s]
    void good() { in_a_row_ = 0; }
    /// `began`: when the try began that failed [s].
    void bad(double began) {
        if (in_a_row_++ == 0) since_ = began;
        failures_.fetch_add(1, std::memory_order_relaxed);
    }
    bool given_up(double now) const { return in_a_row_ >= 2 && now - since_ >= answer_time; }
    void forget() { in_a_row_ = 0; }
    std::int64_t failures() const { return failures_.load(std::memory_order_relaxed); }

  private:
    std::atomic<std::int64_t> failures_{0};  ///< ever
    int in_a_row_ = 0;
    double since_ = 0;
};

}  // namespace palpate
