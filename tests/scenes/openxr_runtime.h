#pragma once
// What a test tells the fake OpenXR runtime, and what that has seen. Both ends are in one process: the loader opens the
// runtime, the test opens it again and asks for openxr_runtime_control().

#include <atomic>
#include <mutex>

namespace palpate::testing {

struct OpenXrControl {
    std::mutex mutex;
    float joints[2][26][7];            ///< [left, right]: x y z, qx qy qz qw
    bool known[2][26];                 ///< the joint's place is valid
    bool active[2];                    ///< the hand is seen
    std::atomic<int> located{0};       ///< times that hands were asked for
    std::atomic<int> instances{0};     ///< alive
    std::atomic<int> made{0};          ///< instances ever
    std::atomic<bool> lost{false};     ///< from now on everything fails; cleared by a new instance
    std::atomic<bool> ends{false};     ///< says so by an event, once
    std::atomic<bool> absent{false};   ///< gives no instance
    std::atomic<bool> misused{false};  ///< asked for hands before the session was running, or with wrong types
};

}  // namespace palpate::testing
