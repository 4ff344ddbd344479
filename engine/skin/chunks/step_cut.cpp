#include "engine/skin/chunks/step_cut.h"

#include <algorithm>

namespace palpate {

bool StepCut::is_late(int pass) {
    if (at >= 0) return true;
    bool late = given >= 0 && pass >= given;
    if (given < 0 && until != Time::max()) {
        const Time now = std::chrono::steady_clock::now();
        if (pass > 0) longest = std::max(longest, now - last);
        last = now;
        late = now + longest >= until;
    }
    if (late) at = pass;
    return late;
}

}  // namespace palpate
