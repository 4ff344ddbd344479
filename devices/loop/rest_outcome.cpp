#include "devices/loop/rest_outcome.h"

#include <chrono>
#include <cmath>

namespace palpate {

namespace {

constexpr double measured_at_rest = 0.1;  ///< a shaft this near counts as there [rad]

std::string last_fault(const BoardStatus& b) {
    std::string reason = b.problem;
    for (const BoardTransition& t : b.transitions)
        if (t.to == BoardState::faulted) reason = t.reason;
    return reason;
}

}  // namespace

RestOutcome rest_outcome(const ThimbleLoop& loop, const Board& board, const std::string& controller,
                         const std::vector<int>& channels, const std::vector<ServoCalibration>& servos) {
    if (const BoardStatus b = board.status(); b.state != BoardState::active)
        return {false, controller + ": " + last_fault(b)};
    if (loop.status.mode == ThimbleMode::fault) return {false, controller + " was lost, and is not re-armed"};
    if (!at_rest(loop)) return {false, "the time was too short"};
    for (std::size_t j = 0; j < channels.size(); ++j)
        if (cut_off(servos[j], loop.rest_q[std::ptrdiff_t(j)]) > 0)
            return {false, "it lies outside of the range of servo " + std::to_string(channels[j])};
    auto everywhere = [&](auto there) {
        for (std::size_t j = 0; j < channels.size(); ++j)
            if (!there(channels[j], servos[j],
                       wire_value(servos[j], board.steps_per_unit(), loop.rest_q[std::ptrdiff_t(j)])))
                return false;
        return true;
    };
    if (!everywhere([&](int c, const ServoCalibration&, WireValue rest) { return board.arrived(c) == rest; }))
        return {false, controller + " did not confirm it"};
    // A watchdog may have bitten since it was asked last, as with the last word.
    for (int k = 0; k < 50 && board.state() == BoardState::active && !board.well_since_told(); ++k)
        std::this_thread::sleep_for(std::chrono::milliseconds(10));
    if (const BoardStatus b = board.status(); b.state != BoardState::active)
        return {false, controller + ": " + last_fault(b)};
    if (!board.well_since_told()) return {false, controller + " did not confirm it"};
    if (!board.measures()) return {true, "as the controllers have taken it; hobby servos do not tell where they are"};
    auto measured = [&](int c, const ServoCalibration& servo, WireValue rest) {
        const double bound = measured_at_rest * std::abs(servo.units_per_rad) * board.steps_per_unit();
        return std::abs(double(board.position(c)) - double(rest)) <= bound;
    };
    for (int k = 0; k < 50 && !everywhere(measured); ++k) std::this_thread::sleep_for(std::chrono::milliseconds(10));
    return everywhere(measured) ? RestOutcome{true, "as measured"}
                                : RestOutcome{false, "its servos are elsewhere, as measured"};
}

}  // namespace palpate
