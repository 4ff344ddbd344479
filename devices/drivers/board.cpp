#include "devices/drivers/board.h"

#include <poll.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <chrono>
#include <stdexcept>

namespace palpate {

namespace {

using Clock = std::chrono::steady_clock;
constexpr auto feed_period = std::chrono::milliseconds(50);
constexpr auto catch_up_period = std::chrono::milliseconds(5);
constexpr auto retry_period = std::chrono::milliseconds(500);
constexpr int tolerated_failures = 3;

double seconds() { return std::chrono::duration<double>(Clock::now().time_since_epoch()).count(); }

}  // namespace

Board::Board(std::unique_ptr<BoardLink> link) : link_(std::move(link)) {
    for (auto& w : wanted_torque_) w = no_torque_limit;
    sent_torque_.fill(no_torque_limit);
    std::array<WireValue, max_channels> positions{};
    const std::string problem = link_->open(positions);
    if (!problem.empty()) throw std::runtime_error(problem);
    take_positions(positions);
    wake_fd_ = eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC);
    if (wake_fd_ < 0) throw std::runtime_error("no event descriptor for the servo controller's thread");
    opened_ = 1;
    state_ = BoardState::ready;
    thread_ = std::thread([this] { serve(); });
}

Board::~Board() {
    stop_ = true;
    wake();
    thread_.join();
    link_->close();
    ::close(wake_fd_);
}

/// A controller as it was found.
void Board::take_positions(std::span<const WireValue> positions) {
    for (std::size_t c = 0; c < max_channels; ++c) {
        position_[c].store(positions[c], std::memory_order_release);
        told_[c] = {positions[c], positions[c], seconds()};
    }
}

void Board::limit(int channel, const WireLimits& limits) {
    const std::lock_guard lock(limits_mutex_);
    limits_[std::size_t(channel)] = limits;
}

void Board::wake() {
    const std::uint64_t one = 1;
    [[maybe_unused]] const auto written = ::write(wake_fd_, &one, sizeof one);  // full: it is awake already
}

void Board::drain() const {
    for (int k = 0; k < 100 && state() == BoardState::ready; ++k) {
        bool waiting = false;
        for (std::size_t c = 0; c < max_channels; ++c) waiting |= wanted_[c] != no_pulse && wanted_[c] != sent_[c];
        if (!waiting) return;
        std::this_thread::sleep_for(std::chrono::milliseconds(2));
    }
}

BoardStatus Board::status() const {
    const std::lock_guard lock(problem_mutex_);
    return {
        state(), problem_, writes_, values_, failures_, opened_, 1e3 * latency_.quantile(0.99), 1e3 * latency_.worst()};
}

bool Board::rearm() {
    if (state() == BoardState::ready) return true;
    if (!back_) return false;
    back_ = false;
    state_.store(BoardState::ready, std::memory_order_release);
    return true;
}

void Board::fail(const LinkProblem& problem) {
    ++failures_;
    {
        const std::lock_guard lock(problem_mutex_);
        problem_ = problem.text;
    }
    if (!problem.lost && ++failures_in_a_row_ < tolerated_failures) return;
    // What was wanted before the loss is not what is wanted after it.
    state_.store(BoardState::lost, std::memory_order_release);
    for (auto& w : wanted_) w.store(no_pulse, std::memory_order_release);
    for (auto& s : sent_) s.store(no_pulse, std::memory_order_release);
    for (auto& w : wanted_torque_) w.store(no_torque_limit, std::memory_order_release);
    sent_torque_.fill(no_torque_limit);
    link_->close();
}

bool Board::open_again() {
    std::array<WireValue, max_channels> positions{};
    const std::string problem = link_->open(positions);
    if (!problem.empty()) {
        const std::lock_guard lock(problem_mutex_);
        problem_ = problem;
        return false;
    }
    take_positions(positions);
    failures_in_a_row_ = 0;
    ++opened_;
    back_ = true;
    return true;
}

void Board::write_changed_torques() {
    std::array<ChannelTarget, max_channels> limits;
    std::size_t count = 0;
    for (int channel = 0; channel < max_channels; ++channel) {
        const auto c = std::size_t(channel);
        const WireValue wanted = wanted_torque_[c].load(std::memory_order_acquire);
        if (wanted != no_torque_limit && wanted != sent_torque_[c]) limits[count++] = {channel, wanted};
    }
    if (count == 0) return;
    const std::span<const ChannelTarget> changed(limits.data(), count);
    if (const LinkProblem problem = link_->write_torques(changed)) return fail(problem);
    for (const ChannelTarget& t : changed) sent_torque_[std::size_t(t.channel)] = t.value;
    ++writes_;
}

/// Sends what is not yet where it is wanted. Returns whether a speed limit held something back.
bool Board::write_changed() {
    std::array<ChannelTarget, max_channels> targets;
    std::array<char, max_channels> arrived{};
    std::size_t count = 0;
    bool held_back = false;
    const double now = seconds();
    for (int channel = 0; channel < max_channels; ++channel) {
        const auto c = std::size_t(channel);
        const WireValue wanted = wanted_[c].load(std::memory_order_acquire), sent = sent_[c];
        if (wanted == no_pulse || wanted == sent) continue;
        WireLimits limits;
        {
            const std::lock_guard lock(limits_mutex_);
            limits = limits_[c];
        }
        const WireValue value = limit_wire(wanted, told_[c], limits, now - told_[c].at);
        held_back |= value != wanted && value != no_pulse;
        if (value != no_pulse && value != sent) targets[count++] = {channel, value};
    }
    if (count == 0) return held_back;
    const LinkProblem problem = link_->write(std::span(targets).first(count), std::span(arrived).first(count));
    const double end = seconds();  // they arrived by now, if at all: the next step's time runs from here
    for (std::size_t i = 0; i < count; ++i) {
        const auto c = std::size_t(targets[i].channel);
        const WireValue value = targets[i].value;
        Told& told = told_[c];
        if (arrived[i] || told.low == no_pulse)
            told = {value, value, end};
        else  // it may have arrived, all the same
            told = {std::min(told.low, value), std::max(told.high, value), end};
        sent_[c] = arrived[i] ? value : no_pulse;
        if (!arrived[i]) continue;
        if (!link_->measures) position_[c].store(targets[i].value, std::memory_order_release);
        ++values_;
    }
    if (problem) return fail(problem), held_back;
    ++writes_;
    latency_.add(end - now);
    failures_in_a_row_ = 0;
    return held_back;
}

void Board::feed() {
    const LinkProblem problem = link_->feed();
    if (problem) return fail(problem);
    if (!link_->measures) return;
    std::array<WireValue, max_channels> positions{};
    std::array<int, max_channels> channels;
    std::size_t used = 0;
    for (int c = 0; c < max_channels; ++c)
        if (sent_[std::size_t(c)] != no_pulse) channels[used++] = c;
    link_->read(std::span(channels).first(used), positions);
    for (std::size_t i = 0; i < used; ++i)
        if (const auto c = std::size_t(channels[i]); positions[c] != no_pulse)
            position_[c].store(positions[c], std::memory_order_release);
}

void Board::serve() {
    auto next_feed = Clock::now(), next_open = Clock::now();
    bool held_back = false;
    while (true) {
        const bool last = stop_;
        pollfd wake{wake_fd_, POLLIN, 0};
        if (!last) ::poll(&wake, 1, int((held_back ? catch_up_period : feed_period).count()));
        std::uint64_t count;
        [[maybe_unused]] const auto got = ::read(wake_fd_, &count, sizeof count);
        if (state() == BoardState::ready) write_changed_torques();  // before what they are to push with
        if (state() == BoardState::ready) {
            held_back = write_changed();
            if (state() == BoardState::ready && Clock::now() >= next_feed) {
                feed();
                next_feed = Clock::now() + feed_period;
            }
        } else if (!back_ && !last && Clock::now() >= next_open) {
            open_again();
            next_open = Clock::now() + retry_period;
        }
        if (last) return;
    }
}

namespace {

class BoardDriver final : public Driver {
  public:
    BoardDriver(std::shared_ptr<Board> board, std::vector<int> channels, std::vector<ServoCalibration> servos)
        : board_(std::move(board)), channels_(std::move(channels)), servos_(std::move(servos)) {}

    DriverStatus send(const Coordinates& q, double) override {
        if (board_->state() != BoardState::ready) return DriverStatus::fault;
        for (std::size_t i = 0; i < channels_.size(); ++i) {
            const double angle = std::ptrdiff_t(i) < q.size() ? q[std::ptrdiff_t(i)] : NAN;
            const WireValue value = wire_value(servos_[i], board_->steps_per_unit(), angle);
            if (value != no_pulse) board_->set(channels_[i], value);
        }
        board_->wake();
        return DriverStatus::ok;
    }

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

  private:
    std::shared_ptr<Board> board_;
    std::vector<int> channels_;
    std::vector<ServoCalibration> servos_;
};

}  // namespace

std::unique_ptr<Driver> make_board_driver(std::shared_ptr<Board> board, std::vector<int> channels,
                                          std::vector<ServoCalibration> servos, double max_speed_rad_per_s) {
    if (channels.size() != servos.size() || channels.size() > max_device_dimension)
        throw std::invalid_argument("a thimble needs one channel and one calibration per joint");
    // A little above the loop's own limit: its ticks come with some jitter.
    for (std::size_t i = 0; i < channels.size(); ++i)
        board->limit(channels[i], wire_limits(servos[i], board->steps_per_unit(), 1.05 * max_speed_rad_per_s));
    return std::make_unique<BoardDriver>(std::move(board), std::move(channels), std::move(servos));
}

}  // namespace palpate
