#pragma once
// A servo controller with many channels that thimbles share. Its own thread talks to it, and alone waits for it.

#include <array>
#include <atomic>
#include <memory>
#include <mutex>
#include <span>
#include <thread>

#include "devices/drivers/driver.h"
#include "devices/drivers/servo.h"
#include "devices/histogram.h"

namespace palpate {

inline constexpr int max_channels = 32;

struct ChannelTarget {
    int channel;
    WireValue value;
};

/// What went wrong; nothing where `text` is empty. `lost`: no use in trying again before the controller is opened anew.
struct LinkProblem {
    std::string text;
    bool lost = false;
    explicit operator bool() const { return !text.empty(); }
};

/// What speaks to one kind of controller; called by the board's thread alone. No call may wait longer than 300 ms.
/// To add a controller, write one of these (drivers/maestro.h and drivers/serial_bus.h are two) and name it in
/// scenes/hardware.cpp.
class BoardLink {
  public:
    virtual ~BoardLink() = default;
    /// Finds and opens the controller. Returns what is wrong, or nothing. `positions` [max_channels] become what its
    /// servos were told last, no_pulse where that is unknown.
    virtual std::string open(std::span<WireValue> positions) = 0;
    virtual void close() = 0;
    /// Sends targets. `arrived` [as targets] becomes 1 for those that did.
    virtual LinkProblem write(std::span<const ChannelTarget> targets, std::span<char> arrived) = 0;
    /// Sends torque limits, where the servos have them.
    virtual LinkProblem write_torques(std::span<const ChannelTarget> /*limits*/) { return {}; }
    /// Keeps the controller's watchdog from biting, and asks how it is.
    virtual LinkProblem feed() = 0;
    /// Positions as measured, where servos report them; leaves the others alone.
    virtual void read(std::span<const int> /*channels*/, std::span<WireValue> /*positions*/) {}
    double steps_per_unit = 4;  ///< wire values per unit of the calibration
    bool measures = false;      ///< read() returns measured positions
};

enum class BoardState { opening, ready, lost };

struct BoardStatus {
    BoardState state;
    std::string problem;  ///< the last one
    std::int64_t writes, values, failures, opened;
    double write_p99_ms, write_worst_ms;
};

class Board {
  public:
    /// Opens the controller in this call. Throws std::runtime_error with what is wrong.
    explicit Board(std::unique_ptr<BoardLink> link);
    ~Board();  ///< sends what is waiting, then stops
    Board(const Board&) = delete;
    Board& operator=(const Board&) = delete;

    /// What a channel may be sent; until then, nothing.
    void limit(int channel, const WireLimits& limits);
    /// The newest target of a channel; sent by the thread after wake(). Never waits.
    void set(int channel, WireValue value) { wanted_[std::size_t(channel)].store(value, std::memory_order_release); }
    /// The newest torque limit of a channel, as `set`; sent before the targets.
    void set_torque(int channel, WireValue value) {
        wanted_torque_[std::size_t(channel)].store(value, std::memory_order_release);
    }
    void wake();
    /// Waits until all targets were sent, for 200 ms at most.
    void drain() const;
    /// What the controller was told last, or measured; no_pulse if unknown.
    WireValue position(int channel) const { return position_[std::size_t(channel)].load(std::memory_order_acquire); }
    /// From the moment that the controller is lost until rearm(): lost.
    BoardState state() const { return state_.load(std::memory_order_acquire); }
    /// Takes a controller that has come back into service; false if it is not there.
    bool rearm();
    double steps_per_unit() const { return link_->steps_per_unit; }
    BoardStatus status() const;

  private:
    void serve();
    bool open_again();
    void take_positions(std::span<const WireValue> positions);
    bool write_changed();
    void write_changed_torques();
    void fail(const LinkProblem& problem);
    void feed();

    std::unique_ptr<BoardLink> link_;
    std::array<std::atomic<WireValue>, max_channels> wanted_{}, position_{};
    std::array<std::atomic<WireValue>, max_channels> sent_{};
    std::array<std::atomic<WireValue>, max_channels> wanted_torque_{};
    std::array<WireValue, max_channels> sent_torque_{};
    std::array<WireLimits, max_channels> limits_{};  ///< guarded by limits_mutex_
    std::array<Told, max_channels> told_{};
    mutable std::mutex limits_mutex_;
    std::atomic<BoardState> state_{BoardState::opening};
    std::atomic<bool> back_{false};  ///< open again after a loss, and waiting for rearm
    std::atomic<bool> stop_{false};
    std::atomic<std::int64_t> writes_{0}, values_{0}, failures_{0}, opened_{0};
    int failures_in_a_row_ = 0;
    LatencyHistogram latency_;
    mutable std::mutex problem_mutex_;
    std::string problem_;
    int wake_fd_ = -1;
    std::thread thread_;
};

/// One thimble's servos on a board.
std::unique_ptr<Driver> make_board_driver(std::shared_ptr<Board> board, std::vector<int> channels,
                                          std::vector<ServoCalibration> servos, double max_speed_rad_per_s);

}  // namespace palpate
