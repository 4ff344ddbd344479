#pragma once
// A controller of the tests' own for Board, without hardware and without an emulator.

#include <atomic>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "devices/drivers/board.h"
#include "tests/real_time.h"

namespace palpate::testing {

/// A controller of our own, which remembers and breaks.
struct FakeState {
    std::mutex mutex;
    std::vector<ChannelTarget> seen;
    std::vector<double> times;        ///< of what was seen [s]
    std::vector<std::size_t> counts;  ///< of targets that each write had
    std::vector<double> speed_shares;
    std::string calls;  ///< w: write, f: feed, F: one that took long, x: one that complained, r: recall; as they end
    std::array<WireValue, max_channels> held{};  ///< what servos hold, whoever knows it
    std::atomic<bool> recalls{false}, recall_fails{false};
    /// Answers to writes are lost, so often; what was written arrives all the same, or does not.
    std::atomic<int> lost_arrive{0}, lost_vanish{0};
    std::atomic<bool> refuse{false}, vanish{false}, there{true}, complain{false};
    std::atomic<bool> bites_when_told{false}, bitten{false};  ///< its watchdog, as a target arrives
    std::atomic<int> delay_ms{0}, feed_delay_ms{0}, apart_ms{0}, deaf{-1}, lets_go{0};
    std::atomic<int> found{5000};  ///< where servo 0 is said to be as the controller is opened
    std::atomic<int> shaft{0};     ///< where servo 0 is, as measured; 0: nobody measures
};
class FakeLink final : public BoardLink {
  public:
    explicit FakeLink(FakeState& state) : state_(state) {
        ask_to_be_served_first();
        measures = state.shaft > 0;
        recalls = state.recalls;
    }
    std::string open(std::span<WireValue> positions) override {
        if (!state_.there) return "not there";
        positions[0] = state_.held[0] = WireValue(state_.found.load());
        return "";
    }
    void close() override {}
    void deactivate() override { ++state_.lets_go; }
    LinkProblem write(std::span<const ChannelTarget> targets, std::span<Transfer> transfers) override {
        std::this_thread::sleep_for(std::chrono::milliseconds(state_.delay_ms));
        if (state_.vanish) return {"gone", true, FaultKind::unplugged};
        if (state_.refuse) return {"refused", false, FaultKind::refused};
        const std::lock_guard lock(state_.mutex);
        state_.calls += 'w';
        state_.bitten = state_.bites_when_told.load();
        state_.counts.push_back(targets.size());
        LinkProblem problem;
        for (std::size_t i = 0; i < targets.size(); ++i) {
            if (targets[i].channel == state_.deaf) {
                problem = {"refused", false, FaultKind::refused};
                continue;
            }
            const bool gone = state_.lost_vanish > 0, unheard = gone || state_.lost_arrive > 0;
            if (!gone) state_.held[std::size_t(targets[i].channel)] = targets[i].value;
            if (unheard) {
                --(gone ? state_.lost_vanish : state_.lost_arrive);
                transfers[i].sent = device_clock();
                problem = {"no answer", false, FaultKind::silent};
                continue;
            }
            state_.seen.push_back(targets[i]);
            transfers[i] = {device_clock(), device_clock() + 1e-3 * state_.apart_ms * double(i)};
            state_.times.push_back(device_clock());
        }
        return problem;
    }
    LinkProblem recall(std::span<const int> channels, std::span<WireValue> held) override {
        const std::lock_guard lock(state_.mutex);
        state_.calls += 'r';
        if (state_.recall_fails) return {"no answer", false, FaultKind::silent};
        for (const int c : channels) held[std::size_t(c)] = state_.held[std::size_t(c)];
        return {};
    }
    LinkProblem feed() override {
        const int delay_ms = state_.feed_delay_ms.exchange(0);
        std::this_thread::sleep_for(std::chrono::milliseconds(delay_ms));
        {
            const std::lock_guard lock(state_.mutex);
            state_.calls += state_.complain ? 'x' : delay_ms > 0 ? 'F' : 'f';
        }
        if (state_.bitten) return {"its watchdog has bitten", true, FaultKind::watchdog};
        if (state_.complain) return {"reports errors", false, FaultKind::reported};
        return state_.vanish ? LinkProblem{"gone", true, FaultKind::unplugged} : LinkProblem{};
    }
    LinkProblem read(std::span<const int> channels, std::span<WireValue> positions) override {
        for (int c : channels) positions[std::size_t(c)] = WireValue(c == 0 ? state_.shaft.load() : 5000);
        return {};
    }
    LinkProblem limit_speed(double share) override {
        const std::lock_guard lock(state_.mutex);
        state_.speed_shares.push_back(share);
        return {};
    }

  private:
    FakeState& state_;
};

}  // namespace palpate::testing
