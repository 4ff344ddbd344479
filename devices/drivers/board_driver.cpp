// One thimble's share of a board.

#include <cmath>
#include <stdexcept>

#include "devices/drivers/board.h"

namespace palpate {

namespace {

class BoardDriver final : public Driver {
  public:
    BoardDriver(std::shared_ptr<Board> board, std::vector<int> channels, std::vector<ServoCalibration> servos)
        : board_(std::move(board)), channels_(std::move(channels)), servos_(std::move(servos)) {}

    DriverStatus send(const Coordinates& q, double, double pose_at) override {
        if (board_->state() != BoardState::active) return DriverStatus::fault;
        for (std::size_t i = 0; i < channels_.size(); ++i) {
            const double angle = std::ptrdiff_t(i) < q.size() ? q[std::ptrdiff_t(i)] : NAN;
            const WireValue value = wire_value(servos_[i], board_->steps_per_unit(), angle);
            if (value != no_pulse) board_->set(channels_[i], value, pose_at);
        }
        return DriverStatus::ok;
    }

    void flush() override { board_->wake(); }

    Coordinates actual(double) override {
        Coordinates q(std::ptrdiff_t(channels_.size()));
        for (std::size_t i = 0; i < channels_.size(); ++i) {
            const WireValue at = board_->position(channels_[i]);
            q[std::ptrdiff_t(i)] = at == no_pulse ? NAN : angle_of(servos_[i], board_->steps_per_unit(), at);
        }
        return q;
    }

    bool limit_torque(const Coordinates& torque) override {
        for (std::size_t i = 0; i < channels_.size(); ++i) {
            const double t = std::ptrdiff_t(i) < torque.size() ? torque[std::ptrdiff_t(i)] : 0;
            const WireValue value = torque_value(servos_[i], t);
            if (value == no_torque_limit) return false;
            board_->set_torque(channels_[i], value);
        }
        return true;
    }

    bool rearm() override { return board_->rearm(); }

    double command_age() const override {
        double oldest = -1;
        for (int c : channels_)
            if (const double age = board_->newest_age(c); age > 0) oldest = std::max(oldest, age);
        return oldest;
    }

  private:
    std::shared_ptr<Board> board_;
    std::vector<int> channels_;
    std::vector<ServoCalibration> servos_;
};

constexpr double jitter = 1.05;         ///< ticks come a little sooner or later than the loop counts on
constexpr double timing_noise = 1.5;    ///< what that does to accelerations
constexpr double full_torque_in = 0.2;  ///< from nothing [s]

}  // namespace

std::unique_ptr<Driver> make_board_driver(std::shared_ptr<Board> board, std::vector<int> channels,
                                          std::vector<ServoCalibration> servos, const BoardDriverLimits& limits) {
    if (channels.size() != servos.size() || channels.size() > max_device_dimension)
        throw std::invalid_argument("a thimble needs one channel and one calibration per joint");
    const double steps = board->steps_per_unit();
    for (std::size_t i = 0; i < channels.size(); ++i) {
        // A little above the loop's own limits.
        WireLimits wire = wire_limits(servos[i], steps, jitter * limits.speed);
        wire.acceleration = std::abs(servos[i].units_per_rad) * steps * timing_noise * limits.acceleration;
        wire.following = std::abs(servos[i].units_per_rad) * steps * limits.following;
        wire.torque_rate = servos[i].torque_max / full_torque_in;
        const bool known = std::ptrdiff_t(i) < limits.rest.size();
        board->limit(channels[i], wire,
                     known ? wire_value(servos[i], steps, limits.rest[std::ptrdiff_t(i)]) : no_pulse);
    }
    return std::make_unique<BoardDriver>(std::move(board), std::move(channels), std::move(servos));
}

}  // namespace palpate
