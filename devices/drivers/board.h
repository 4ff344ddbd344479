#pragma once
// A servo controller with many channels that thimbles share. Its own thread talks to it, and alone waits for it.

#include <array>
#include <atomic>
#include <filesystem>
#include <memory>
#include <mutex>
#include <span>
#include <thread>

#include "devices/drivers/answer_watch.h"
#include "devices/drivers/audit.h"
#include "devices/drivers/board_link.h"
#include "devices/drivers/driver.h"
#include "devices/drivers/first_move.h"
#include "devices/drivers/following_error.h"
#include "devices/loop/clock.h"
#include "devices/loop/histogram.h"

namespace palpate {

struct BoardStatus {
    BoardState state;
    FaultKind fault;      ///< that latched last
    std::string problem;  ///< the last one
    std::int64_t wakes, writes, values, failures, opened, faults;
    double write_p99_ms, write_worst_ms;
    std::array<std::int64_t, max_channels> write_failures, read_failures;  ///< per servo
    std::vector<BoardTransition> transitions;                              ///< the first and the last hundred
    std::string lost_audits;                                               ///< files that could not be written
};

class Board {
  public:
    /// Opens the controller in this call, and activates it. Throws std::runtime_error with what is wrong. What it was
    /// sent in the last minutes is written to `audit`_1.csv and so on at each fault; nowhere where that is empty.
    explicit Board(std::unique_ptr<BoardLink> link, std::filesystem::path audit = {});
    ~Board();  ///< sends what is waiting, then stops
    Board(const Board&) = delete;
    Board& operator=(const Board&) = delete;

    /// What a channel may be sent; until then, nothing. `rest`: where a dying program leaves it; no_pulse: as it is.
    void limit(int channel, const WireLimits& limits, WireValue rest = no_pulse);
    /// The newest target of a channel; sent by the thread after wake(), all in one write. Never waits.
    void set(int channel, WireValue value, double pose_at = 0);
    /// The newest torque limit of a channel, as `set`; sent before the targets.
    void set_torque(int channel, WireValue value) {
        wanted_torque_[std::size_t(channel)].store(value, std::memory_order_release);
        waiting_.store(true, std::memory_order_release);
    }
    /// Has what was set sent now; once, however many thimbles share the controller.
    void wake();
    /// Waits until all targets were sent, for `seconds` at most. False where some were not.
    bool drain(double seconds = 0.2) const;
    /// What the controller was told last, or measured; no_pulse if unknown.
    WireValue position(int channel) const { return position_[std::size_t(channel)].load(std::memory_order_acquire); }
    /// What was sent last, and surely arrived; no_pulse if there is no such value.
    WireValue arrived(int channel) const { return sent_[std::size_t(channel)].load(std::memory_order_acquire); }
    /// It was asked how it is since it was told something last, and all was well.
    bool well_since_told() const { return heard_at_ >= told_at_; }
    bool measures() const { return link_->measures; }
    BoardState state() const { return state_.load(std::memory_order_acquire); }
    /// Takes a controller that has come back after a fault into service; false if it is not there.
    bool rearm();
    double steps_per_unit() const { return link_->steps_per_unit; }
    BoardStatus status() const;
    /// From a tracked pose's arrival to the end of the transfer that it led to, of one channel: all, and the newest
    /// [s].
    const LatencyHistogram& age(int channel) const { return age_[std::size_t(channel)]; }
    double newest_age(int channel) const { return newest_age_[std::size_t(channel)].load(std::memory_order_relaxed); }

    /// In a signal handler, once and for all: takes the controller from its thread, and moves all servos to their rest
    /// values within their limits. Allocates nothing and takes no lock. False once nothing is left to do.
    void seize() noexcept;
    bool rest_in_signal(double elapsed) noexcept;

  private:
    void serve();
    double pause(double now) const;
    void take_turns(bool& urgent);
    void write_audit();
    void ring();
    void exchange();
    void activate();
    bool open_again();
    void take_positions(std::span<const WireValue> positions);
    std::size_t due_targets(std::span<ChannelTarget> targets, double now);
    void write_changed();
    void note_write(const ChannelTarget& target, const Transfer& transfer, double began, double end);
    void count_age(std::size_t channel, double age);
    void write_changed_torques();
    void feed();
    bool recall_lost();
    void take_held(std::size_t channel, WireValue held);
    void read_positions(double began);
    void end_easing();
    void fail(const LinkProblem& problem, bool given_up);
    void latch(const LinkProblem& problem);
    void enter(BoardState state, const std::string& reason);
    WireLimits limits_of(std::size_t channel) const;

    std::unique_ptr<BoardLink> link_;
    std::filesystem::path audit_file_;
    /// Value in the low 16 bits, when the tracked pose behind it arrived [us] above: one word, so that they cannot
    /// part.
    std::array<std::atomic<std::uint64_t>, max_channels> wanted_{};
    std::array<std::atomic<WireValue>, max_channels> position_{}, sent_{}, rest_{}, wanted_torque_{};
    std::array<std::atomic<WireValue>, max_channels>
        underway_{};  ///< sent, and not known to have arrived; no_pulse: none
    std::array<std::atomic<double>, max_channels> newest_age_{};
    std::array<LatencyHistogram, max_channels> age_;
    std::array<WireValue, max_channels> sent_torque_{};
    std::array<double, max_channels> torque_at_{};   ///< when it was sent [s]
    std::array<WireLimits, max_channels> limits_{};  ///< written under limits_mutex_, before targets come
    std::array<Told, max_channels> told_{};
    std::array<AnswerWatch, max_channels> write_watch_, read_watch_;
    std::array<FollowingError, max_channels> following_{};
    AnswerWatch feed_watch_, recall_watch_, torque_watch_, read_problem_watch_;
    Audit audit_;
    mutable std::mutex limits_mutex_;
    std::atomic<BoardState> state_{BoardState::unconfigured};
    std::atomic<bool> rearm_asked_{false}, stop_{false}, seized_{false}, waiting_{false};
    std::atomic<std::int64_t> wakes_{0}, writes_{0}, values_{0}, failures_{0}, opened_{0}, faults_{0};
    std::array<double, max_channels> due_pose_{}, counted_pose_{};  ///< poses behind what is sent, and was counted [s]
    bool easing_ = false, held_back_ = false, audit_due_ = false;
    std::array<bool, max_channels> lost_{};  ///< nobody knows whether a transfer arrived; to be asked for
    bool unheard_ = false;                   ///< how it is was asked, and got no good answer
    std::array<FirstMove, max_channels> first_moves_{};
    double ease_until_ = 0;  ///< at least [s]
    double last_word_ = 0, next_feed_ = 0, next_open_ = 0;
    std::atomic<double> told_at_{0}, heard_at_{0};             ///< a write's end, a good answer's question [s]
    double woken_at_ = 0, wakes_every_ = 0, write_takes_ = 0;  ///< the rhythm of ticks, and of what they send [s]
    LatencyHistogram latency_;
    mutable std::mutex problem_mutex_;
    std::string problem_, lost_audits_;
    FaultKind fault_ = FaultKind::none;
    std::vector<BoardTransition> transitions_;
    int wake_fd_ = -1;
    std::thread thread_;
};

struct BoardDriverLimits {
    double speed = 6;         ///< [rad/s]
    double acceleration = 0;  ///< [rad/s^2]; 0: none
    double following = 0.15;  ///< bound on the following error [rad]; 0: none, as where force is limited
    Coordinates rest = {};    ///< where a dying program leaves the joints [rad]; empty: as they are
};

/// One thimble's servos on a board.
std::unique_ptr<Driver> make_board_driver(std::shared_ptr<Board> board, std::vector<int> channels,
                                          std::vector<ServoCalibration> servos, const BoardDriverLimits& limits);

}  // namespace palpate
