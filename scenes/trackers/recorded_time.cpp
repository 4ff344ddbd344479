#include "scenes/trackers/recorded_time.h"

#include <algorithm>
#include <cmath>

namespace palpate {

namespace {

/// What is farther from its arrival was told by a clock that was started anew, or counts no seconds [s].
constexpr double tolerated = 1;

}  // namespace

double RecordedTime::of(int hand, double arrival, std::optional<double> own) {
    Hand& h = hands_[std::size_t(hand)];
    const Hand& other = hands_[std::size_t(1 - hand)];
    double seen = arrival;
    if (own) {
        const auto fits = [&](const std::optional<double>& ahead) {
            return ahead && std::abs(*own + *ahead - arrival) <= tolerated;
        };
        if (!fits(h.ahead)) h.ahead = fits(other.ahead) ? *other.ahead : arrival - *own;  // hands of one tracker
        seen = *own + *h.ahead;
    }
    return h.last = std::max(h.last, seen);
}

}  // namespace palpate
