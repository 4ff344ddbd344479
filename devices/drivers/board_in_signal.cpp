// What a board does in the signal handler of a program that dies: no allocation, no locks, nothing awaited.

#include <algorithm>

#include "devices/drivers/board.h"

namespace palpate {

void Board::seize() noexcept {
    seized_ = true;
    for (std::size_t c = 0; c < max_channels; ++c) {
        const WireValue sent = sent_[c], at = sent == no_pulse ? position_[c].load() : sent;
        const WireValue underway = underway_[c];  // it may arrive, or not
        const bool either = at != no_pulse && underway != no_pulse;
        told_[c] = {either ? std::min(at, underway) : at, either ? std::max(at, underway) : at, 0};
    }
}

bool Board::rest_in_signal(double elapsed) noexcept {
    if (state() != BoardState::active) return false;
    ChannelTarget targets[max_channels];
    std::size_t count = 0;
    for (int channel = 0; channel < max_channels; ++channel) {
        const auto c = std::size_t(channel);
        const WireValue rest = rest_[c], at = told_[c].low;
        const bool known = at == told_[c].high;
        if (rest == no_pulse || at == no_pulse || (known && rest == at)) continue;
        WireLimits limits = limits_[c];
        if (easing_) limits.speed *= first_move_share;
        const WireValue value = limit_wire(rest, told_[c], limits, elapsed);
        if (value == no_pulse || (known && value == at)) continue;
        targets[count++] = {channel, value};
        told_[c] = told_after(told_[c], value, true, limits, elapsed, 0);
    }
    return count > 0 && link_->write_in_signal({targets, count});
}

}  // namespace palpate
