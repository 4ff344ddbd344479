#include "devices/drivers/first_move.h"

#include <algorithm>
#include <cmath>

namespace palpate {

namespace {

constexpr double settled = 0.2;       ///< after the time that the way takes [s]
constexpr double slower_share = 0.9;  ///< controllers' own limits are a little below those of what they are told

}  // namespace

double longest_travel(const Told& before, WireValue value, const WireLimits& limits) {
    if (before.low == no_pulse) return double(limits.max) - double(limits.min);
    return std::max(std::abs(double(value) - before.low), std::abs(double(value) - before.high));
}

void FirstMove::told(double travel, double speed, double now) {
    if (met_ || !(speed > 0)) return;
    there_at_ = std::max(there_at_, now) + travel / (slower_share * speed);
}

bool FirstMove::caught_up(const Place& place, double now) {
    if (over_) return true;
    if (place.sent == no_pulse) return false;
    const int side = (place.wanted > place.sent) - (place.wanted < place.sent);
    met_ |= side == 0 || (side_ != 0 && side != side_);
    side_ = side;
    const bool there = !(place.bound > 0) || std::abs(double(place.measured) - double(place.sent)) <= place.bound;
    over_ = met_ && there && now > there_at_ + settled;
    return over_;
}

}  // namespace palpate
