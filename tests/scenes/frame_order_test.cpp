// Which messages about a hand are taken: time that stands still, senders and clocks that take turns.

#include "scenes/trackers/frame_order.h"

#include <arpa/inet.h>
#include <sys/socket.h>
#include <unistd.h>

#include <nlohmann/json.hpp>

#include "scenes/trackers/hand_doubts.h"
#include "scenes/trackers/hand_source.h"
#include "scenes/trackers/recorded_time.h"
#include "tests/support.h"

namespace palpate {
namespace {

/// An order, and a time that goes on as it is told.
struct Judge {
    FrameOrder order{};
    DeviceClock::time_point now = DeviceClock::time_point(std::chrono::hours(1));
    void wait(double s) { now += std::chrono::nanoseconds(std::llround(1e9 * s)); }
    FrameVerdict judge(std::optional<double> time, const std::string& sender = "") {
        return order.judge(now, time, sender);
    }
    bool takes(std::optional<double> time, const std::string& sender = "") {
        return judge(time, sender) == FrameVerdict::taken;
    }
};

TEST(FrameOrder, WhatStandsStillInTimeIsNotTaken) {
    Judge j;
    EXPECT_TRUE(j.takes(5));
    for (int k = 0; k < 500; ++k, j.wait(0.012)) EXPECT_EQ(j.judge(5), FrameVerdict::standing) << k;
    EXPECT_TRUE(j.takes(5.012));
    EXPECT_EQ(j.judge(5), FrameVerdict::overtaken);
    for (int k = 0; k < 500; ++k, j.wait(0.012)) EXPECT_TRUE(j.takes(std::nullopt)) << "no clock, no judgement";
    // One that resends two old hands, more than a second apart, gives nothing new either.
    Judge two;
    EXPECT_TRUE(two.takes(5) && two.takes(9));
    for (int k = 0; k < 500; ++k, two.wait(0.012)) EXPECT_EQ(two.judge(k % 2 ? 9 : 5), FrameVerdict::standing) << k;
}

TEST(FrameOrder, TwoSendersDoNotTakeTurns) {
    for (const bool clocks : {false, true}) {
        Judge j;
        int taken[2] = {0, 0}, turns = 0, last = -1;
        for (int k = 0; k < 400; ++k, j.wait(0.006)) {
            const int who = k % 2;
            const auto time = clocks ? std::optional(0.006 * k + 1000 * who) : std::nullopt;
            if (!j.takes(time, who ? "B" : "A")) continue;
            ++taken[who];
            turns += last >= 0 && last != who;
            last = who;
        }
        EXPECT_EQ(taken[0], 200) << "the first one";
        EXPECT_LT(taken[1], FrameOrder::settled + 1);
        EXPECT_LT(turns, 2 * FrameOrder::settled);
        // Who was in use falls silent: after two seconds, and not before, the other one is listened to.
        for (int k = 0; k < 160; ++k, j.wait(0.012)) EXPECT_FALSE(j.takes(1010 + 0.012 * k, "B")) << k;
        j.wait(0.2);
        for (int k = 0; k < 160; ++k, j.wait(0.012)) EXPECT_TRUE(j.takes(1020 + 0.012 * k, "B")) << k;
        EXPECT_EQ(j.judge(3, "A"), FrameVerdict::other_sender);
    }
}

TEST(FrameOrder, WhoHasEndedIsNotWaitedFor) {
    Judge j;
    for (int k = 0; k < 20; ++k, j.wait(0.012)) EXPECT_TRUE(j.takes(std::nullopt, "A"));
    EXPECT_EQ(j.judge(std::nullopt, "B"), FrameVerdict::other_sender);
    j.order.forget("A");
    EXPECT_TRUE(j.takes(std::nullopt, "B"));
}

/// Some programs open a port for every message: nobody can tell those from two senders, but by their clocks.
TEST(FrameOrder, SendersThatChangeWithEveryMessageAreListenedTo) {
    Judge j;
    for (int k = 0; k < 200; ++k, j.wait(0.012)) EXPECT_TRUE(j.takes(0.012 * k, "port " + std::to_string(k))) << k;
    EXPECT_EQ(j.judge(0.012 * 199, "port 200"), FrameVerdict::standing);
    Judge without;
    for (int k = 0; k < 200; ++k, without.wait(0.012))
        EXPECT_TRUE(without.takes(std::nullopt, "port " + std::to_string(k))) << k;
}

TEST(FrameOrder, TwoClocksDoNotTakeTurns) {
    Judge j;
    for (int k = 0; k < 50; ++k, j.wait(0.012)) EXPECT_TRUE(j.takes(0.012 * k));
    int strangers = 0;
    for (int k = 50; k < 200; ++k) {
        strangers += j.takes(1000 + 0.012 * k);
        j.wait(0.006);
        EXPECT_TRUE(j.takes(0.012 * k)) << k;
        j.wait(0.006);
    }
    EXPECT_EQ(strangers, 1) << "which is the first, that might have been a tracker started anew";
    for (int k = 0; k < 400; ++k, j.wait(0.012)) strangers += j.takes(1010 + 0.012 * k);
    EXPECT_GT(strangers, 200) << "alone, it is listened to";
}

TEST(FrameOrder, AClockThatStartsAnewOrCountsOtherwiseIsTaken) {
    Judge j;
    for (int k = 0; k < 50; ++k, j.wait(0.012)) EXPECT_TRUE(j.takes(100 + 0.012 * k));
    for (int k = 0; k < 500; ++k, j.wait(0.012)) EXPECT_TRUE(j.takes(0.012 * k)) << "a tracker that was started anew";
    for (int k = 0; k < 500; ++k, j.wait(0.012)) EXPECT_TRUE(j.takes(0.012 * (k % 158))) << "a recording in a loop";
    for (const double unit : {1e3, 1e6, 1e9}) {
        Judge fast;
        for (int k = 0; k < 200; ++k, fast.wait(0.012)) EXPECT_TRUE(fast.takes(0.012 * k * unit)) << unit;
    }
}

/// Twenty frames at once, every quarter of a second, of a tracker that saw them one after the other.
TEST(RecordedTime, IsWhenItWasSeenAndNotWhenItCame) {
    RecordedTime bursts, none, fast;
    double last = 0;
    for (int k = 0; k < 400; ++k) {
        const double own = 500 + 0.012 * k, arrival = 3 + 0.24 * (k / 20) + 1e-5 * (k % 20);
        const double right = bursts.of(1, arrival, own), left = bursts.of(0, arrival + 1e-5, own);
        EXPECT_NEAR(right - last, k ? 0.012 : 3, 1e-9) << k;
        EXPECT_EQ(left, right) << "hands of one tracker";
        EXPECT_EQ(none.of(1, arrival, {}), arrival);
        EXPECT_NEAR(fast.of(1, arrival, 1000 * own), arrival, 1) << "no clock of seconds";
        last = right;
    }
    EXPECT_NEAR(bursts.of(1, 9, 0.5), 9, 1e-9) << "started anew";
    EXPECT_NEAR(bursts.of(1, 9.012, 0.512), 9.012, 1e-9);
    EXPECT_GE(bursts.of(1, 9.013, 0.3), 9.012) << "no recording runs backward";
}

HandFrame some_hand(double x = 0) {
    HandFrame frame;
    frame.valid = true;
    for (auto& finger : frame.finger) finger = {{x, 0, 0}, {1, 0, 0, 0}};
    return frame;
}

std::string doubts_of(const HandMailbox& mailbox) {
    std::string all;
    for (const HandDoubt& doubt : hand_doubts(mailbox)) all += doubt.text + "\n";
    return all;
}

TEST(HandMailbox, AHandWhoseTimeStandsStillIsNotSeen) {
    HandMailbox mailbox;
    mailbox.take(1, some_hand(), 1.0);
    mailbox.take(1, some_hand(), 1.1);
    EXPECT_TRUE(mailbox.newest(1, 1).valid);
    EXPECT_TRUE(testing::eventually([&] {
        mailbox.take(1, some_hand(0.1), 1.1);
        return !mailbox.newest(1, 1).valid && mailbox.stands_still(1);
    }));
    EXPECT_EQ(mailbox.arrived_at(1), 0) << "its age is not that of the message";
    EXPECT_EQ(mailbox.newest(1, 1).pose.position.x, 0) << "what came with an old time is old";
    EXPECT_EQ(mailbox.counts().standstills, 1);
    EXPECT_NE(doubts_of(mailbox).find("quarter of a second or more, 1 time ("), std::string::npos)
        << doubts_of(mailbox);
    mailbox.take(1, some_hand(), 1.2);
    EXPECT_TRUE(mailbox.newest(1, 1).valid);
    EXPECT_FALSE(mailbox.stands_still(1));
    HandFrame gone = some_hand();
    gone.valid = false;
    mailbox.take(1, gone, 1.2);
    EXPECT_FALSE(mailbox.newest(1, 1).valid) << "that nothing is seen is believed";
}

TEST(HandMailbox, UnitsOfTimeThatLookWrongAreSaid) {
    const std::pair<double, const char*> units[] = {{1, ""}, {1e3, "milliseconds"}, {1e6, "microseconds"}};
    for (const auto& [unit, word] : units) {
        HandMailbox mailbox;
        const double began = device_clock();
        for (int k = 0; k < 40; ++k, ::usleep(5000)) mailbox.take(1, some_hand(), unit * (device_clock() - began));
        EXPECT_EQ(mailbox.counts().frames[1], 40) << "all are taken";
        EXPECT_EQ(mailbox.timing().has_clock, unit == 1);
        const std::string doubts = doubts_of(mailbox), said = std::string("\"t\" looks like ") + word;
        EXPECT_TRUE(unit == 1 ? doubts.empty() : doubts.find(said) != std::string::npos) << doubts;
    }
}

TEST(HandMailbox, AStrayFrameByAnotherClockIsNoDelay) {
    HandMailbox mailbox;
    for (int k = 0; k < 20; ++k, ::usleep(2000)) {
        mailbox.take(1, some_hand(), 5 + 0.002 * k);
        mailbox.take(1, some_hand(1), 1005 + 0.002 * k);
    }
    EXPECT_EQ(mailbox.newest(1, 1).pose.position.x, 0);
    EXPECT_LT(mailbox.timing().delay_p95_ms, 1000);
    EXPECT_NE(doubts_of(mailbox).find("two clocks at once"), std::string::npos) << doubts_of(mailbox);
}

TEST(RecordedTime, OfRecordingsUnitsThatLookWrongAreSaid) {
    const std::pair<double, const char*> units[] = {{1, ""}, {1e3, "milli"}, {1e6, "micro"}, {1e9, "nano"}};
    for (const auto& [unit, word] : units)
        for (const double interval : {0.005, 0.02, 0.033}) {
            HandRecording recording;
            for (int k = 0; k < 20; ++k) {
                recording.frames.push_back(some_hand());
                recording.frames.back().time = unit * interval * k;
            }
            const std::string problem = recorded_time_problem(recording);
            const std::string said = std::string("\"t\" looks like ") + word;
            EXPECT_TRUE(unit == 1 ? problem.empty() : problem.find(said) != std::string::npos) << problem;
        }
}

/// A UDP socket that keeps its port.
struct SteadySender {
    int socket = ::socket(AF_INET, SOCK_DGRAM, 0);
    std::string name;
    explicit SteadySender(int port) {
        sockaddr_in to{};
        to.sin_family = AF_INET;
        to.sin_port = htons(std::uint16_t(port));
        to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
        socklen_t size = sizeof to;
        EXPECT_EQ(::connect(socket, reinterpret_cast<sockaddr*>(&to), size), 0);
        ::getsockname(socket, reinterpret_cast<sockaddr*>(&to), &size);
        name = "127.0.0.1:" + std::to_string(ntohs(to.sin_port));
    }
    ~SteadySender() { ::close(socket); }
    void send(double x, double t) const {
        nlohmann::json frame{{"t", t}, {"joints", nlohmann::json::array()}};
        for (int k = 0; k < hand_joint_count; ++k) frame["joints"].push_back({x, 0, -0.01 * k, 0, 0, 0, 1});
        const std::string text = frame.dump();
        EXPECT_EQ(::send(socket, text.data(), text.size(), 0), ssize_t(text.size()));
    }
};

TEST(UdpHand, OfTwoSendersOneIsListenedToAndBothAreNamed) {
    LiveHands live("udp:0");
    const SteadySender a(live.source->port()), b(live.source->port());
    const auto handled = [&] {
        const HandCounts c = live.mailbox.counts();
        return c.frames[1] + c.other_sender + c.other_clock;
    };
    for (int k = 0; k < 100; ++k) {
        a.send(0, 1 + 0.001 * k);
        b.send(1, 1001 + 0.001 * k);
        ASSERT_TRUE(testing::eventually([&] { return handled() == 2 * (k + 1); }));
        if (k > 2) { EXPECT_EQ(live.mailbox.newest(1, 1).pose.position.x, 0) << k; }
    }
    EXPECT_NE(doubts_of(live.mailbox).find(a.name + " is listened to"), std::string::npos) << doubts_of(live.mailbox);
    EXPECT_NE(doubts_of(live.mailbox).find(" of " + b.name), std::string::npos) << doubts_of(live.mailbox);
}

}  // namespace
}  // namespace palpate
