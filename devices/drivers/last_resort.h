#pragma once
// Servos at rest, even where the program dies: abort, std::terminate, memory that is broken or used up.

#include "devices/drivers/board.h"

namespace palpate {

/// What such a signal does: boards go to rest, and the program dies of it. Also a handler for others.
extern "C" void rest_then_die(int signal);

/// As long as one of these lives, a signal that ends the program moves the board's servos to their rest values first,
/// within their limits. That takes no memory and no lock: only what a signal handler may do. Signals that have a
/// handler already are left to it. (Against SIGKILL stands the controller's own watchdog.)
class RestOnDeath {
  public:
    static constexpr int at_most = 16;  ///< at a time, for a signal handler sees nothing but what is global
    /// Throws std::runtime_error where there are as many already.
    explicit RestOnDeath(std::shared_ptr<Board> board);
    ~RestOnDeath();
    RestOnDeath(const RestOnDeath&) = delete;
    RestOnDeath& operator=(const RestOnDeath&) = delete;

  private:
    std::shared_ptr<Board> board_;
};

}  // namespace palpate
