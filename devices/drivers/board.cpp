#include "devices/drivers/board.h"

#include <poll.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <stdexcept>
#include <utility>

namespace palpate {

namespace {

constexpr double feed_period = 0.05, retry_period = 0.5;
constexpr double catch_up_period = 0.005;
constexpr double shortest_first_move = 0.2;  ///< [s]
constexpr std::size_t remembered_transitions = 200;

std::uint64_t packed(WireValue value, double pose_at) {
    const double us = std::clamp(1e6 * pose_at, 0.0, 2e14);
    return std::uint64_t(us) << 16 | value;
}
WireValue value_of(std::uint64_t wanted) { return WireValue(wanted & 0xFFFF); }
double pose_time_of(std::uint64_t wanted) { return 1e-6 * double(wanted >> 16); }

}  // namespace

Board::Board(std::unique_ptr<BoardLink> link, std::filesystem::path audit)
    : link_(std::move(link)), audit_file_(std::move(audit)) {
    for (auto& w : wanted_torque_) w = no_torque_limit;
    sent_torque_.fill(no_torque_limit);
    std::array<WireValue, max_channels> positions{};
    if (const std::string problem = link_->open(positions); !problem.empty()) throw std::runtime_error(problem);
    take_positions(positions);
    opened_ = 1;
    enter(BoardState::inactive, "opened");
    activate();
    if (state() != BoardState::active) throw std::runtime_error(problem_);
    wake_fd_ = eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC);
    if (wake_fd_ < 0) throw std::runtime_error("no event descriptor for the servo controller's thread");
    thread_ = std::thread([this] { serve(); });
}

Board::~Board() {
    stop_ = true;
    ring();
    thread_.join();
    link_->close();
    ::close(wake_fd_);
}

void Board::enter(BoardState next, const std::string& reason) {
    const std::lock_guard lock(problem_mutex_);
    if (transitions_.size() >= remembered_transitions)
        transitions_.erase(transitions_.begin() + remembered_transitions / 2);
    transitions_.push_back({device_clock(), state(), next, reason});
    state_.store(next, std::memory_order_release);
}

/// A controller as it was found.
void Board::take_positions(std::span<const WireValue> positions) {
    const double now = device_clock();
    for (std::size_t c = 0; c < max_channels; ++c) {
        position_[c].store(positions[c], std::memory_order_release);
        told_[c] = {positions[c], positions[c], now};
        underway_[c] = no_pulse;
        following_[c].start(positions[c], now);
        write_watch_[c].forget();
        read_watch_[c].forget();
    }
    lost_.fill(false);
    for (AnswerWatch* watch : {&feed_watch_, &recall_watch_, &torque_watch_, &read_problem_watch_}) watch->forget();
}

void Board::activate() {
    if (const LinkProblem problem = link_->activate()) return latch(problem);
    for (auto& w : wanted_) w.store(no_pulse, std::memory_order_release);  // of before, where a tick met the fault
    easing_ = true;
    first_moves_.fill({});
    held_back_ = unheard_ = false;
    last_word_ = device_clock();
    ease_until_ = last_word_ + shortest_first_move;
    enter(BoardState::active, "armed");
}

void Board::limit(int channel, const WireLimits& limits, WireValue rest) {
    const std::lock_guard lock(limits_mutex_);
    limits_[std::size_t(channel)] = limits;
    rest_[std::size_t(channel)] = rest;
}

WireLimits Board::limits_of(std::size_t channel) const {
    const std::lock_guard lock(limits_mutex_);
    return limits_[channel];
}

void Board::set(int channel, WireValue value, double pose_at) {
    wanted_[std::size_t(channel)].store(packed(value, pose_at), std::memory_order_release);
    waiting_.store(true, std::memory_order_release);
}

void Board::wake() {
    if (!waiting_.exchange(false)) return;
    ++wakes_;
    ring();
}

void Board::ring() {
    const std::uint64_t one = 1;
    [[maybe_unused]] const auto written = ::write(wake_fd_, &one, sizeof one);  // full: it is awake already
}

bool Board::drain(double seconds) const {
    const double end = device_clock() + seconds;
    while (state() == BoardState::active) {
        bool waiting = false;
        for (std::size_t c = 0; c < max_channels; ++c) {
            const WireValue wanted = value_of(wanted_[c]);
            waiting |= wanted != no_pulse && wanted != sent_[c];
        }
        if (!waiting) return true;
        if (device_clock() > end) return false;
        std::this_thread::sleep_for(std::chrono::milliseconds(2));
    }
    return false;
}

BoardStatus Board::status() const {
    const std::lock_guard lock(problem_mutex_);
    BoardStatus s{state(), fault_, problem_, wakes_, writes_, values_,      failures_,   opened_,
                  faults_, 0,      0,        {},     {},      transitions_, lost_audits_};
    s.write_p99_ms = 1e3 * latency_.quantile(0.99);
    s.write_worst_ms = 1e3 * latency_.worst();
    for (std::size_t c = 0; c < max_channels; ++c) {
        s.write_failures[c] = write_watch_[c].failures();
        s.read_failures[c] = read_watch_[c].failures();
    }
    return s;
}

bool Board::rearm() {
    if (state() == BoardState::inactive) {
        rearm_asked_ = true;
        ring();
    }
    return state() == BoardState::active;
}

/// Counts a problem; latches where it is final, or where there was no good answer for too long.
void Board::fail(const LinkProblem& problem, bool given_up) {
    ++failures_;
    {
        const std::lock_guard lock(problem_mutex_);
        problem_ = problem.text;
    }
    if (problem.lost || given_up) latch(problem);
}

void Board::latch(const LinkProblem& problem) {
    if (seized_) return;
    const bool was_active = state() == BoardState::active;  // one that waits to be re-armed is in a fault already
    faults_ += was_active;
    {
        const std::lock_guard lock(problem_mutex_);
        problem_ = problem.text;
        fault_ = problem.kind;
    }
    rearm_asked_ = false;
    enter(BoardState::faulted, std::string(name(problem.kind)) + ": " + problem.text);
    // What was wanted before the fault is not what is wanted after it.
    for (auto& w : wanted_) w.store(no_pulse, std::memory_order_release);
    for (auto& s : sent_) s.store(no_pulse, std::memory_order_release);
    for (auto& w : wanted_torque_) w.store(no_torque_limit, std::memory_order_release);
    sent_torque_.fill(no_torque_limit);
    held_back_ = false;
    link_->deactivate();
    link_->close();
    next_open_ = device_clock() + 0.2 * retry_period;
    audit_due_ |= was_active && !audit_file_.empty();
}

/// Once nothing is urgent any more.
void Board::write_audit() {
    audit_due_ = false;
    const std::string file = audit_file_.string() + "_" + std::to_string(faults_) + ".csv";
    if (audit_.write(file, status().transitions, device_clock())) return;
    const std::lock_guard lock(problem_mutex_);
    lost_audits_ += (lost_audits_.empty() ? "" : ", ") + file;
}

bool Board::open_again() {
    std::array<WireValue, max_channels> positions{};
    const std::string problem = link_->open(positions);
    next_open_ = device_clock() + retry_period;
    if (!problem.empty()) {
        const std::lock_guard lock(problem_mutex_);
        problem_ = problem;
        return false;
    }
    take_positions(positions);
    return true;
}

void Board::write_changed_torques() {
    std::array<ChannelTarget, max_channels> values;
    std::size_t count = 0;
    const double began = device_clock();
    for (int channel = 0; channel < max_channels; ++channel) {
        const auto c = std::size_t(channel);
        const WireValue wanted = wanted_torque_[c].load(std::memory_order_acquire);
        if (wanted == no_torque_limit || wanted == sent_torque_[c]) continue;
        const WireValue value = limit_torque_wire(wanted, sent_torque_[c], limits_of(c), began - torque_at_[c]);
        held_back_ |= value != wanted;
        if (value != sent_torque_[c]) values[count++] = {channel, value};
    }
    if (count == 0) return;
    const std::span<const ChannelTarget> changed(values.data(), count);
    const LinkProblem problem = link_->write_torques(changed);
    const double end = device_clock();
    for (const ChannelTarget& t : changed) {
        audit_.add({end, -1, std::int8_t(t.channel), !problem, true, t.value});
        torque_at_[std::size_t(t.channel)] = end;
        if (!problem) sent_torque_[std::size_t(t.channel)] = t.value;
    }
    if (problem) {
        torque_watch_.bad(began);
        return fail(problem, torque_watch_.given_up(end));
    }
    torque_watch_.good();
    ++writes_;
}

/// Targets that are not yet where they are wanted, as near as limits let them be now. Returns how many.
std::size_t Board::due_targets(std::span<ChannelTarget> targets, double now) {
    std::size_t count = 0;
    for (int channel = 0; channel < max_channels; ++channel) {
        const auto c = std::size_t(channel);
        const std::uint64_t both = wanted_[c].load(std::memory_order_acquire);
        const WireValue wanted = value_of(both), sent = sent_[c];
        if (wanted == no_pulse || wanted == sent) continue;
        due_pose_[c] = pose_time_of(both);
        WireLimits limits = limits_of(c);
        if (easing_) limits.speed *= first_move_share;
        const WireValue value = limit_wire(wanted, told_[c], limits, now - told_[c].at);
        if (value == no_pulse) continue;
        held_back_ |= value != wanted;
        if (value != sent) targets[count++] = {channel, value};
    }
    return count;
}

/// Sends what is not yet where it is wanted.
void Board::write_changed() {
    std::array<ChannelTarget, max_channels> due;
    std::array<Transfer, max_channels> transfers{};
    const double began = device_clock();
    const std::size_t count = due_targets(due, began);
    if (count == 0) return;
    if (device_clock() - last_word_ > ask_first_after) {  // the process was stopped since it last asked
        held_back_ = true;
        return;
    }
    const std::span<const ChannelTarget> targets(due.data(), count);
    for (const ChannelTarget& t : targets) underway_[std::size_t(t.channel)] = t.value;
    if (seized_) return;  // whoever seizes sees either this write, or none
    const LinkProblem problem = link_->write(targets, std::span(transfers).first(count));
    const double end = device_clock();
    told_at_ = end;  // before anybody can see that it arrived
    bool given_up = false;
    for (std::size_t i = 0; i < count; ++i) {
        note_write(targets[i], transfers[i], began, end);
        given_up |= write_watch_[std::size_t(targets[i].channel)].given_up(end);
    }
    if (problem) return fail(problem, given_up);
    ++writes_;
    latency_.add(end - began);
    write_takes_ = std::max(end - began, 0.9 * write_takes_);
    last_word_ = began;  // not its end: the process may have been stopped while it waited for that
}

/// For limits it was told at the end of the whole write, for its age as its own transfer ended.
void Board::note_write(const ChannelTarget& target, const Transfer& transfer, double began, double end) {
    const auto c = std::size_t(target.channel);
    const bool arrived = transfer.arrived > 0;
    Told& told = told_[c];
    const WireLimits limits = limits_of(c);
    const double over = std::max(end, transfer.arrived);
    first_moves_[c].told(longest_travel(told, target.value, limits), first_move_share * limits.speed, over);
    told = told_after(told, target.value, arrived, limits, began - told.at, over, transfer.arrived - told.sent);
    told.took = over - began;
    told.sent = transfer.sent;
    sent_[c] = arrived ? target.value : no_pulse;
    lost_[c] = !arrived && link_->recalls;
    if (arrived) underway_[c] = no_pulse;
    following_[c].told(target.value, end);
    const double pose_at = due_pose_[c], age = (arrived ? transfer.arrived : end) - pose_at;
    audit_.add({end, pose_at > 0 ? float(age) : -1.0f, std::int8_t(target.channel), arrived, false, target.value});
    if (!arrived) return write_watch_[c].bad(began);
    write_watch_[c].good();
    ++values_;
    if (!link_->measures) position_[c].store(target.value, std::memory_order_release);
    count_age(c, age);
}

/// Once per pose, of those that arrived: late ones are old, and are counted as that.
void Board::count_age(std::size_t channel, double age) {
    const double pose_at = due_pose_[channel];
    if (pose_at <= 0 || pose_at == std::exchange(counted_pose_[channel], pose_at)) return;
    age_[channel].add(age);
    newest_age_[channel].store(age, std::memory_order_relaxed);
}

void Board::feed() {
    const double began = device_clock();
    next_feed_ = began + feed_period;
    if (const LinkProblem problem = link_->feed()) {
        unheard_ = true;
        feed_watch_.bad(began);
        fail(problem, feed_watch_.given_up(device_clock()));
    } else {
        unheard_ = false;
        feed_watch_.good();
        last_word_ = began;
        heard_at_ = began;
    }
    if (link_->measures && (state() == BoardState::active || state() == BoardState::inactive)) read_positions(began);
}

/// Asks for what servos hold of which a transfer was lost. False where that is not known yet.
bool Board::recall_lost() {
    std::array<int, max_channels> channels;
    std::array<WireValue, max_channels> held{};
    std::size_t count = 0;
    for (std::size_t c = 0; c < max_channels; ++c)
        if (lost_[c]) channels[count++] = int(c);
    if (count == 0) return true;
    const double began = device_clock();
    const std::span<const int> lost(channels.data(), count);
    if (const LinkProblem problem = link_->recall(lost, held)) {
        recall_watch_.bad(began);
        fail(problem, recall_watch_.given_up(device_clock()));
        return false;
    }
    recall_watch_.good();
    feed();  // where its watchdog has bitten, what they hold is not what they were told
    if (unheard_ || seized_ || state() != BoardState::active) return false;
    for (const int c : lost) take_held(std::size_t(c), held[std::size_t(c)]);
    return state() == BoardState::active;
}

/// It goes on from there, as one that stands.
void Board::take_held(std::size_t channel, WireValue held) {
    const WireValue lost = underway_[channel].exchange(no_pulse);
    lost_[channel] = false;
    if (held == no_pulse && position_[channel] != no_pulse)
        return fail({"servo " + std::to_string(channel) + " gets no pulses any more", true, FaultKind::watchdog}, true);
    if (held == lost) {
        write_watch_[channel].good();
        ++values_;
        count_age(channel, device_clock() - due_pose_[channel]);
    }
    Told& told = told_[channel];
    told = {held, held, told.at, 0, told.took, told.sent};
    sent_[channel] = held;
    if (!link_->measures) position_[channel].store(held, std::memory_order_release);
}

/// Where servos are; whether each answers, and follows.
void Board::read_positions(double began) {
    std::array<WireValue, max_channels> positions{};
    std::array<int, max_channels> channels;
    std::size_t used = 0;
    for (int c = 0; c < max_channels; ++c)
        if (limits_of(std::size_t(c)).max > 0) channels[used++] = c;
    if (used == 0) return;
    LinkProblem problem = link_->read(std::span(channels).first(used), positions);
    const double now = device_clock();
    problem ? read_problem_watch_.bad(began) : read_problem_watch_.good();
    if (problem.lost) return fail(problem, true);
    bool given_up = read_problem_watch_.given_up(now), silent = false;
    for (std::size_t i = 0; i < used; ++i) {
        const auto c = std::size_t(channels[i]);
        const std::string servo = "servo " + std::to_string(channels[i]);
        if (positions[c] == no_pulse) {
            read_watch_[c].bad(began);
            silent = true;
            given_up |= read_watch_[c].given_up(now);
            if (!problem) problem = {servo + " does not answer", false, FaultKind::silent};
            continue;
        }
        read_watch_[c].good();
        position_[c].store(positions[c], std::memory_order_release);
        const FaultKind astray = following_[c].measured(positions[c], limits_of(c).following, now);
        if (astray != FaultKind::none && state() == BoardState::active)
            return fail(
                {servo + " is at " + std::to_string(positions[c]) + " and was told " + std::to_string(told_[c].high) +
                     ": it " + (astray == FaultKind::blocked ? "does not move" : "does not follow"),
                 true, astray},
                true);
    }
    if (!silent) last_word_ = now;
    if (problem) fail(problem, given_up);
}

/// Once all servos that are commanded have made their first move, they may be fast.
void Board::end_easing() {
    if (!easing_) return;
    const double now = device_clock();
    int moved = 0, caught_up = 0;
    for (std::size_t c = 0; c < max_channels; ++c) {
        const WireValue wanted = value_of(wanted_[c]);
        if (wanted == no_pulse) continue;
        ++moved;
        const double bound = link_->measures ? limits_of(c).following : 0;
        caught_up += first_moves_[c].caught_up({wanted, sent_[c], position_[c], bound}, now);
    }
    if (moved == 0 || caught_up < moved || now < ease_until_) return;
    if (const LinkProblem problem = link_->limit_speed(1)) {
        ease_until_ = now + shortest_first_move;  // tried again
        feed_watch_.bad(now);
        return fail(problem, feed_watch_.given_up(device_clock()));
    }
    easing_ = false;
}

void Board::exchange() {
    held_back_ = false;
    if (unheard_ || device_clock() - last_word_ > ask_first_after) feed();
    // Its watchdog may have bitten, or servos hold nobody knows what: nothing is told meanwhile.
    if (unheard_ || (state() == BoardState::active && !recall_lost())) return void(held_back_ = true);
    if (state() == BoardState::active) write_changed_torques();  // before what they are to push with
    if (state() == BoardState::active) write_changed();
    if (state() == BoardState::active && device_clock() >= next_feed_) feed();
    if (state() == BoardState::active) end_easing();
}

/// How long nobody has to be told anything, but for what a tick brings. What servos catch up with is sent between
/// ticks, and is out of their way.
double Board::pause(double now) const {
    constexpr double longest_period = 0.1;
    if (!held_back_) return feed_period;
    const double tick = woken_at_ + wakes_every_, begins = now + catch_up_period, ends = begins + write_takes_;
    const bool delays_it = wakes_every_ < longest_period && begins < tick && ends > tick;
    return delays_it ? tick + catch_up_period - now : catch_up_period;
}

/// A board that moves comes before other work; to look for one that is lost, and to write down why, can wait.
void Board::take_turns(bool& urgent) {
    if (const bool active = state() == BoardState::active; active != std::exchange(urgent, active))
        come_before_other_work(pthread_self(), active ? 19 : 0);
    if (!urgent && audit_due_) write_audit();
}

void Board::serve() {
    bool urgent = false;
    while (true) {
        const bool last = stop_;
        take_turns(urgent);
        pollfd wake{wake_fd_, POLLIN, 0};
        if (!last) ::poll(&wake, 1, int(1e3 * pause(device_clock())));
        std::uint64_t count;
        if (::read(wake_fd_, &count, sizeof count) > 0) {
            const double now = device_clock();
            wakes_every_ = now - std::exchange(woken_at_, now);
        }
        if (seized_) {
            if (last) return;
            continue;
        }
        if (state() == BoardState::active) {
            exchange();
        } else if (state() == BoardState::inactive && rearm_asked_.exchange(false)) {
            // Servos may be elsewhere by now.
            open_again() ? activate() : latch({status().problem, true, FaultKind::unplugged});
        } else if (state() == BoardState::inactive && device_clock() >= next_feed_) {
            feed();
        } else if (state() == BoardState::faulted && !last && device_clock() >= next_open_) {
            if (!open_again()) continue;
            ++opened_;
            enter(BoardState::inactive, "found again; waits to be re-armed");
        }
        if (last) return take_turns(urgent);
    }
}

}  // namespace palpate
