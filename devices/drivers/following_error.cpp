#include "devices/drivers/following_error.h"

#include <algorithm>
#include <cmath>

namespace palpate {

void FollowingError::start(WireValue position, double now) {
    *this = {};
    std::fill(std::begin(low_), std::end(low_), position);
    std::fill(std::begin(high_), std::end(high_), position);
    last_ = position;
    span_began_ = now;
}

/// Moves on to the next span where this one is over; it begins with what holds.
void FollowingError::advance(double now) {
    while (now - span_began_ > lag) {
        const bool longer_ago = now - span_began_ > 2 * lag;
        low_[1] = longer_ago ? last_ : low_[0], high_[1] = longer_ago ? last_ : high_[0];
        low_[0] = high_[0] = last_;
        span_began_ = longer_ago ? now : span_began_ + lag;
    }
}

void FollowingError::told(WireValue value, double now) {
    if (last_ == no_pulse) return start(value, now);
    advance(now);
    last_ = value;
    low_[0] = std::min(low_[0], value);
    high_[0] = std::max(high_[0], value);
}

FaultKind FollowingError::measured(WireValue position, double bound, double now) {
    if (!(bound > 0) || last_ == no_pulse) return FaultKind::none;
    advance(now);
    const double low = std::min(low_[0], low_[1]), high = std::max(high_[0], high_[1]);
    if (position >= low - bound && position <= high + bound) {
        astray_since_ = -1;
        return FaultKind::none;
    }
    if (astray_since_ < 0) astray_since_ = now, astray_from_ = position;
    if (now - astray_since_ < patience) return FaultKind::none;
    return std::abs(double(position) - double(astray_from_)) > 0.5 * bound ? FaultKind::off_course : FaultKind::blocked;
}

}  // namespace palpate
