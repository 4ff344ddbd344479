// Servo controllers without hardware: what goes on the wire, and what happens when it breaks.

#include <pty.h>
#include <unistd.h>

#include <thread>

#include "devices/device_thread.h"
#include "devices/drivers/maestro_protocol.h"
#include "devices/drivers/serial_bus.h"
#include "devices/drivers/serial_protocol.h"
#include "tests/support.h"

namespace palpate {
namespace {

TEST(WireValue, AnySequenceStaysInRangeAndInsideTheSpeedLimit) {
    std::mt19937 random(1);
    std::uniform_real_distribution<double> u(-1, 1);
    const double special[] = {NAN, INFINITY, -INFINITY, 1e300, -1e300, 0};
    for (const ServoCalibration& servo : {ServoCalibration{}, ServoCalibration{1500, -636.62, 1000.1, 1999.9},
                                          ServoCalibration{2048, 651.9, 1024, 3072}}) {
        const double steps = servo.zero > 2000 ? 1 : 4;
        const WireLimits limits = wire_limits(servo, steps, 6);
        Told told;
        for (int i = 0; i < 10000000; ++i) {
            const double angle = i % 7 == 0 ? special[random() % 6] : (i % 3 ? 1.5 : 40.0) * u(random);
            const double elapsed = i % 11 == 0 ? special[random() % 6] : 0.12 * u(random);
            const WireValue wanted = i % 13 ? wire_value(servo, steps, angle) : WireValue(random());
            const WireValue value = limit_wire(wanted, told, limits, elapsed);
            if (value == no_pulse) {
                ASSERT_EQ(wanted, no_pulse);
                continue;
            }
            ASSERT_GE(value, servo.min * steps);
            ASSERT_LE(value, servo.max * steps);
            const double time = std::isfinite(elapsed) ? std::clamp(elapsed, 0.0, 0.1) : 0;
            const double step = std::abs(servo.units_per_rad) * steps * 6 * time;
            // From wherever it may be: no farther than a step, or than half of what is not known.
            if (told.low != no_pulse) {
                const double most = std::max(step, 0.5 * (told.high - told.low) + 1);
                ASSERT_LE(std::abs(int(value) - int(told.low)), most);
                ASSERT_LE(std::abs(int(value) - int(told.high)), most);
            }
            if (told.low == no_pulse || random() % 10)
                told = {value, value, 0};
            else  // lost, or not
                told = {std::min(told.low, value), std::max(told.high, value), 0};
            if (i % 1000 == 0) told = {};
        }
    }
    EXPECT_EQ(limit_wire(6000, {6000, 6000, 0}, {}, 0.02), no_pulse);  // a channel without limits is not driven
}

TEST(WireValue, AnglesComeBack) {
    for (const ServoCalibration& servo : {ServoCalibration{}, ServoCalibration{1480, -600, 900, 2100}})
        for (double q = -0.6; q <= 0.6; q += 0.01)
            EXPECT_NEAR(angle_of(servo, 4, wire_value(servo, 4, q)), q, 0.126 / 600);
}

TEST(ServoCalibrations, ClashingNumbersAreRefused) {
    EXPECT_TRUE(ServoCalibration{}.validate().empty());
    EXPECT_FALSE((ServoCalibration{1500, 0, 992, 2000}.validate().empty()));
    EXPECT_FALSE((ServoCalibration{2500, 600, 992, 2000}.validate().empty()));
    EXPECT_FALSE((ServoCalibration{1500, 600, 2000, 992}.validate().empty()));
    EXPECT_FALSE((ServoCalibration{1500, NAN, 992, 2000}.validate().empty()));
}

TEST(MaestroProtocol, RequestsAsDocumented) {
    using namespace maestro;
    EXPECT_EQ(set_target(3, 6000), (Request{0x40, 0x85, 6000, 3, 0}));
    EXPECT_EQ(set_speed(3, 140), (Request{0x40, 0x84, 140, 3, 0}));
    EXPECT_EQ(clear_errors(), (Request{0x40, 0x86, 0, 0, 0}));
    EXPECT_EQ(set_parameter(serial_timeout_parameter, 2, 20), (Request{0x40, 0x82, 20, 0x206, 0}));
    EXPECT_EQ(get_variables(18).length, 8);
    EXPECT_EQ(get_variables(6).length, 98 + 42);
    EXPECT_EQ(get_servo_settings(24).length, 168);
    EXPECT_EQ(channels_of_product(0x8b), 18);
    EXPECT_EQ(channels_of_product(0x8e), 0);
    EXPECT_FALSE(channels_of_product(0x1234));
}

TEST(MaestroProtocol, RepliesOfAnotherLengthAreNone) {
    using namespace maestro;
    Bytes reply(8);
    reply[2] = 0x21;
    EXPECT_EQ(parse_variables(18, reply)->errors, 0x21);
    EXPECT_EQ(describe_errors(0x21), "serial signal, serial timeout");
    for (std::size_t n : {0u, 7u, 9u, 140u}) EXPECT_FALSE(parse_variables(18, Bytes(n)));
    Bytes micro(140);
    micro[98 + 7] = 0x70, micro[98 + 8] = 0x17;
    EXPECT_EQ(parse_servo(6, 1, micro)->position, 6000);
    EXPECT_FALSE(parse_servo(6, 6, micro));
    EXPECT_FALSE(parse_servo(18, 0, micro));
}

TEST(SerialProtocols, PublishedExamples) {
    // Pololu Maestro user's guide, 5.e: channel 2 to 1500 us; channel 3 off and channel 4 to 1500 us in one command.
    const ChannelTarget one[] = {{2, 6000}};
    EXPECT_EQ(compact::set_targets(one, true), (Bytes{0x84, 0x02, 0x70, 0x2E}));
    const ChannelTarget two[] = {{3, 0}, {4, 6000}};
    EXPECT_EQ(compact::set_targets(two, true), (Bytes{0x9F, 0x02, 0x03, 0x00, 0x00, 0x70, 0x2E}));
    EXPECT_EQ(compact::set_speed(5, 140), (Bytes{0x87, 0x05, 0x0C, 0x01}));
    // Dynamixel protocol 2.0, e-manual: ping of 1; present position of 1; goal positions 150 and 170 of 1 and 2.
    EXPECT_EQ(dynamixel::instruction(1, dynamixel::ping, {}),
              (Bytes{0xFF, 0xFF, 0xFD, 0x00, 0x01, 0x03, 0x00, 0x01, 0x19, 0x4E}));
    EXPECT_EQ(dynamixel::read_register(1, 132, 4),
              (Bytes{0xFF, 0xFF, 0xFD, 0x00, 0x01, 0x07, 0x00, 0x02, 0x84, 0x00, 0x04, 0x00, 0x1D, 0x15}));
    const ChannelTarget goals[] = {{1, 150}, {2, 170}};
    EXPECT_EQ(dynamixel::write_targets(goals),
              (Bytes{0xFF, 0xFF, 0xFD, 0x00, 0xFE, 0x11, 0x00, 0x83, 0x74, 0x00, 0x04, 0x00,
                     0x01, 0x96, 0x00, 0x00, 0x00, 0x02, 0xAA, 0x00, 0x00, 0x00, 0x82, 0x87}));
    // Feetech STS, protocol manual: ping of 1; present position of 1, and its answer.
    EXPECT_EQ(feetech::instruction(1, 1, {}), (Bytes{0xFF, 0xFF, 0x01, 0x02, 0x01, 0xFB}));
    EXPECT_EQ(feetech::read_register(1, 56, 2), (Bytes{0xFF, 0xFF, 0x01, 0x04, 0x02, 0x38, 0x02, 0xBE}));
    StatusReader reader(StatusReader::Protocol::feetech);
    reader.add(Bytes{0xFF, 0xFF, 0x01, 0x04, 0x00, 0x18, 0x05, 0xDD});
    const auto answer = reader.next();
    ASSERT_TRUE(answer);
    EXPECT_EQ(answer->parameters, (Bytes{0x18, 0x05}));
    StatusReader wide(StatusReader::Protocol::dynamixel);
    wide.add(Bytes{0xFF, 0xFF, 0xFD, 0x00, 0x01, 0x08, 0x00, 0x55, 0x00, 0xA6, 0x00, 0x00, 0x00, 0x8C, 0xC0});
    const auto position = wide.next();
    ASSERT_TRUE(position);
    EXPECT_EQ(position->parameters, (Bytes{0xA6, 0, 0, 0}));
}

/// What a Dynamixel servo would answer: instruction 0x55, an error byte, parameters.
Bytes dynamixel_status(int id, Bytes parameters) {
    parameters.insert(parameters.begin(), 0);
    return dynamixel::instruction(std::uint8_t(id), 0x55, parameters);
}
Bytes feetech_status(int id, const Bytes& parameters) { return feetech::instruction(std::uint8_t(id), 0, parameters); }

TEST(SerialProtocols, PacketsAreFoundAmongNoiseInAnyPieces) {
    std::mt19937 random(2);
    for (const auto protocol : {StatusReader::Protocol::dynamixel, StatusReader::Protocol::feetech})
        for (int run = 0; run < 3000; ++run) {
            StatusReader reader(protocol);
            Bytes line;
            std::vector<Bytes> sent;
            for (int k = 0; k < 4; ++k) {
                // Noise that cannot pass for the beginning of a packet.
                for (unsigned n = random() % 9; n > 0; --n) line.push_back(std::uint8_t(random() % 0xF0));
                Bytes parameters;
                for (unsigned n = random() % 9; n > 0; --n)
                    parameters.push_back(std::uint8_t(random() % 3 ? 0xFF - 2 * (random() % 2) : random()));
                sent.push_back(parameters);
                const Bytes packet = protocol == StatusReader::Protocol::dynamixel ? dynamixel_status(k + 1, parameters)
                                                                                   : feetech_status(k + 1, parameters);
                line.insert(line.end(), packet.begin(), packet.end());
            }
            std::size_t found = 0;
            for (std::size_t at = 0; at < line.size();) {
                const std::size_t piece = std::min<std::size_t>(1 + random() % 7, line.size() - at);
                reader.add(std::span(line).subspan(at, piece));
                at += piece;
                while (const auto p = reader.next()) {
                    ASSERT_LT(found, sent.size());
                    EXPECT_EQ(p->parameters, sent[found]);
                    EXPECT_EQ(p->id, int(++found));
                }
            }
            EXPECT_EQ(found, sent.size());
        }
}

TEST(SerialProtocols, HostileBytesAreDiscarded) {
    std::mt19937 random(3);
    for (const auto protocol : {StatusReader::Protocol::dynamixel, StatusReader::Protocol::feetech})
        for (int run = 0; run < 2000; ++run) {
            StatusReader reader(protocol);
            for (int k = 0; k < 30; ++k) {
                Bytes bytes(random() % 40);
                for (auto& b : bytes) b = std::uint8_t(random() % 2 ? 0xFF - random() % 4 : random());
                reader.add(bytes);
                while (reader.next()) {}
            }
        }
}

/// A controller of our own, which remembers and breaks.
struct FakeState {
    std::mutex mutex;
    std::vector<ChannelTarget> seen;
    std::atomic<bool> refuse{false}, vanish{false}, there{true};
    std::atomic<int> delay_ms{0};
};
class FakeLink final : public BoardLink {
  public:
    explicit FakeLink(FakeState& state) : state_(state) {}
    std::string open(std::span<WireValue> positions) override {
        if (!state_.there) return "not there";
        positions[0] = 5000;
        return "";
    }
    void close() override {}
    LinkProblem write(std::span<const ChannelTarget> targets, std::span<char> arrived) override {
        std::this_thread::sleep_for(std::chrono::milliseconds(state_.delay_ms));
        if (state_.vanish) return {"gone", true};
        if (state_.refuse) return {"refused"};
        const std::lock_guard lock(state_.mutex);
        for (std::size_t i = 0; i < targets.size(); ++i) state_.seen.push_back(targets[i]), arrived[i] = 1;
        return {};
    }
    LinkProblem feed() override { return state_.vanish ? LinkProblem{"gone", true} : LinkProblem{}; }

  private:
    FakeState& state_;
};

template <class Condition>
bool eventually(Condition condition) {
    for (int k = 0; k < 2000; ++k) {
        if (condition()) return true;
        std::this_thread::sleep_for(std::chrono::milliseconds(2));
    }
    return false;
}

TEST(Board, SendsOnlyWhatChanged) {
    FakeState state;
    Board board(std::make_unique<FakeLink>(state));
    for (int k = 0; k < 5; ++k) {
        board.limit(2, wire_limits({}, 4, 6));
        board.limit(3, wire_limits({}, 4, 6));
        board.set(2, 6000);
        board.set(3, 6100);
        board.set(4, 6200);  // without limits
        board.wake();
        board.drain();
    }
    EXPECT_EQ(state.seen.size(), 2u);
    EXPECT_EQ(board.position(0), 5000);
    EXPECT_EQ(board.position(2), 6000);
}

TEST(Board, OneFailureIsTriedAgainManyAreALoss) {
    FakeState state;
    Board board(std::make_unique<FakeLink>(state));
    board.limit(1, wire_limits({}, 4, 6));
    state.refuse = true;
    board.set(1, 6000);
    board.wake();
    ASSERT_TRUE(eventually([&] { return board.status().failures > 0; }));
    state.refuse = false;
    ASSERT_TRUE(eventually([&] { return board.position(1) == 6000; }));
    EXPECT_EQ(board.state(), BoardState::ready);
    state.refuse = true;
    board.set(1, 6400);
    ASSERT_TRUE(eventually([&] { return board.state() == BoardState::lost; }));
    EXPECT_EQ(board.status().problem, "refused");
}

TEST(Board, WhatWasWantedBeforeALossIsNotSentAfterIt) {
    FakeState state;
    auto board = std::make_shared<Board>(std::make_unique<FakeLink>(state));
    DeviceModel model = find_kind("chinello-3rrs")->defaults();
    ThimbleLoop loop;
    initialise(loop, model, {}, make_board_driver(board, {0, 1, 2}, std::vector<ServoCalibration>(3), 6));
    double t = 0;
    tick(loop, t += 0.02);
    board->drain();
    state.there = false;
    state.vanish = true;
    ASSERT_TRUE(eventually([&] { return board->state() == BoardState::lost; }));
    tick(loop, t += 0.02);
    EXPECT_EQ(loop.status.mode, ThimbleMode::fault);
    {
        const std::lock_guard lock(state.mutex);
        state.seen.clear();
    }
    EXPECT_FALSE(rearm(loop, t));
    state.vanish = false;
    state.there = true;
    ASSERT_TRUE(eventually([&] { return board->status().opened == 2; }));
    tick(loop, t += 0.02);
    std::this_thread::sleep_for(std::chrono::milliseconds(60));
    EXPECT_EQ(loop.status.mode, ThimbleMode::fault);
    EXPECT_TRUE(state.seen.empty());  // latched, although it is back
    EXPECT_TRUE(rearm(loop, t));
    tick(loop, t += 0.02);
    board->drain();
    EXPECT_FALSE(state.seen.empty());
    EXPECT_EQ(loop.status.mode, ThimbleMode::resting);
}

TEST(Board, ASlowControllerDelaysNoTick) {
    FakeState state;
    state.delay_ms = 150;
    auto board = std::make_shared<Board>(std::make_unique<FakeLink>(state));
    auto driver = make_board_driver(board, {0, 1, 2}, std::vector<ServoCalibration>(3), 6);
    const auto start = std::chrono::steady_clock::now();
    for (int k = 0; k < 200; ++k) driver->send(Eigen::Vector3d(0.001 * k, 0, 0), 0.02 * k);
    // Two hundred sends would take half a minute if they waited; this bound is far from both.
    EXPECT_LT(std::chrono::steady_clock::now() - start, std::chrono::seconds(5));
}

TEST(DeviceThreads, StartWhereServosAreAndEndInTheRestPose) {
    FakeState state;
    auto board = std::make_shared<Board>(std::make_unique<FakeLink>(state));
    ThimbleLoop loop;
    initialise(loop, find_kind("chinello-3rrs")->defaults(), {},
               make_board_driver(board, {0, 1, 2}, std::vector<ServoCalibration>(3), 6));
    {
        DeviceThread thread({&loop});
        for (int k = 0; k < 30; ++k) {
            loop.mailbox.publish({0, Eigen::Vector3d(0.2, -0.2, 0.1), true});
            std::this_thread::sleep_for(std::chrono::milliseconds(10));
        }
        EXPECT_NEAR(angle_of({}, 4, board->position(0)), 0.2, 0.126 / 636);
    }
    board->drain();
    EXPECT_TRUE(at_rest(loop));
    for (int j = 0; j < 3; ++j)
        EXPECT_NEAR(angle_of({}, 4, board->position(j)), loop.rest_q[j], 0.126 / 636) << "joint " << j;
    // Never faster than the limit: the board takes at most one target a channel and tick.
    WireValue last = 5000;
    const std::lock_guard lock(state.mutex);
    for (const ChannelTarget& t : state.seen) {
        if (t.channel != 0) continue;
        EXPECT_LE(std::abs(t.value - last), 4 * 636.62 * 6 * 1.05 * 0.1);
        last = t.value;
    }
}

/// The other end of a serial line: a thread that answers like servos.
class PtyServos {
  public:
    explicit PtyServos(SerialProtocol protocol) : protocol_(protocol) {
        int slave = -1;
        char name[256];
        if (openpty(&master_, &slave, name, nullptr, nullptr) != 0) throw std::runtime_error("no pty");
        port = name;
        slave_ = slave;
        thread_ = std::thread([this] { serve(); });
    }
    ~PtyServos() {
        stop_ = true;
        thread_.join();
        ::close(master_);
        if (slave_ >= 0) ::close(slave_);
    }
    std::string port;
    std::map<int, int> goals() {
        const std::lock_guard lock(mutex_);
        return goals_;
    }
    std::map<std::pair<int, int>, int> registers() {
        const std::lock_guard lock(mutex_);
        return registers_;
    }
    std::atomic<bool> silent{false};

  private:
    void say(const Bytes& bytes) {
        if (!silent) [[maybe_unused]]
            const auto n = ::write(master_, bytes.data(), bytes.size());
    }
    void serve() {
        Bytes in;
        while (!stop_) {
            timeval wait{0, 5000};
            fd_set set;
            FD_ZERO(&set);
            FD_SET(master_, &set);
            if (::select(master_ + 1, &set, nullptr, nullptr, &wait) <= 0) continue;
            std::uint8_t bytes[256];
            const auto n = ::read(master_, bytes, sizeof bytes);
            if (n > 0) in.insert(in.end(), bytes, bytes + n);
            const std::lock_guard lock(mutex_);
            while (protocol_ == SerialProtocol::maestro_compact ? take_compact(in) : take_packet(in)) {}
        }
    }
    static void erase(Bytes& in, std::size_t n) { in.erase(in.begin(), in.begin() + std::ptrdiff_t(n)); }
    bool take_compact(Bytes& in) {
        if (in.empty()) return false;
        const std::size_t need = in[0] == 0x84 || in[0] == 0x87   ? 4
                                 : in[0] == 0x90                  ? 2
                                 : in[0] == 0xA1                  ? 1
                                 : in[0] == 0x9F && in.size() > 1 ? 3 + 2 * std::size_t(in[1])
                                                                  : 3;
        if (in.size() < need) return false;
        if (in[0] == 0x84) goals_[in[1]] = in[2] | in[3] << 7;
        if (in[0] == 0x9F)
            for (int k = 0; k < in[1]; ++k)
                goals_[in[2] + k] = in[std::size_t(3 + 2 * k)] | in[std::size_t(4 + 2 * k)] << 7;
        if (in[0] == 0x90) say({std::uint8_t(goals_[in[1]]), std::uint8_t(goals_[in[1]] >> 8)});
        if (in[0] == 0xA1) say({0, 0});
        return erase(in, need), true;
    }
    int position(int id) { return goals_.count(id) ? goals_[id] : 2000; }
    bool take_packet(Bytes& in) {
        const bool wide = protocol_ == SerialProtocol::dynamixel;
        if (in.size() < (wide ? 7u : 4u)) return false;
        const std::size_t whole = wide ? 7u + (in[5] | in[6] << 8) : 4u + in[3];
        if (in.size() < whole) return false;
        const int id = in[wide ? 4 : 2], what = in[wide ? 7 : 4];
        const Bytes p(in.begin() + (wide ? 8 : 5), in.begin() + std::ptrdiff_t(whole) - (wide ? 2 : 1));
        const std::size_t a = wide ? 2 : 1, size = wide ? 4 : 2;
        auto number = [&](std::size_t at, std::size_t bytes) {
            int v = 0;
            for (std::size_t k = 0; k < bytes; ++k) v |= p[at + k] << 8 * k;
            return v;
        };
        if (what == 3) registers_[{id, number(0, a)}] = number(a, p.size() - a);
        if (what == 0x83)
            for (std::size_t at = 2 * a; at + 1 + size <= p.size(); at += 1 + size)
                goals_[p[at]] = number(at + 1, size);
        if (what == 0x82)
            for (std::size_t at = 2 * a; at < p.size(); ++at) {
                const int v = position(p[at]);
                const auto low = std::uint8_t(v), high = std::uint8_t(v >> 8);
                say(wide ? dynamixel_status(p[at], {low, high, 0, 0}) : feetech_status(p[at], {low, high}));
            }
        return erase(in, whole), true;
    }

    SerialProtocol protocol_;
    int master_ = -1, slave_ = -1;
    std::atomic<bool> stop_{false};
    std::mutex mutex_;
    std::map<int, int> goals_;
    std::map<std::pair<int, int>, int> registers_;
    std::thread thread_;
};

class SerialBuses : public ::testing::TestWithParam<SerialProtocol> {};
INSTANTIATE_TEST_SUITE_P(All, SerialBuses,
                         ::testing::Values(SerialProtocol::maestro_compact, SerialProtocol::dynamixel,
                                           SerialProtocol::feetech));

TEST_P(SerialBuses, TargetsArriveAndPositionsComeBack) {
    PtyServos servos(GetParam());
    SerialBusSettings settings;
    settings.protocol = GetParam();
    settings.port = servos.port;
    settings.channels = {4, 5, 6, 9};
    settings.speed_units_per_s = 4000;
    settings.need_watchdog = GetParam() == SerialProtocol::dynamixel;
    Board board(make_serial_bus(settings));
    for (int c : settings.channels) {
        board.limit(c, {1000, 3000, 1e9});
        board.set(c, WireValue(2000 + c));
    }
    board.wake();
    board.drain();
    EXPECT_TRUE(eventually([&] {
        const auto goals = servos.goals();
        for (int c : settings.channels)
            if (!goals.count(c) || goals.at(c) != 2000 + c) return false;
        return true;
    }));
    EXPECT_TRUE(eventually([&] { return board.position(9) == 2009; }));
    EXPECT_EQ(board.state(), BoardState::ready);
    if (GetParam() == SerialProtocol::dynamixel) {
        EXPECT_EQ(servos.registers().at({4, dynamixel::torque_enable}), 1);
        EXPECT_EQ(servos.registers().at({9, dynamixel::bus_watchdog}), 10);
    }
    servos.silent = true;
    EXPECT_TRUE(eventually([&] { return board.state() == BoardState::lost; }));
}

TEST_P(SerialBuses, SilenceAtTheStartIsAProblem) {
    PtyServos servos(GetParam());
    servos.silent = true;
    SerialBusSettings settings;
    settings.protocol = GetParam();
    settings.port = servos.port;
    settings.channels = {1};
    settings.need_watchdog = false;
    EXPECT_THROW(Board board(make_serial_bus(settings)), std::runtime_error);
    settings.port = "/dev/null";
    EXPECT_THROW(Board board(make_serial_bus(settings)), std::runtime_error);
    settings.port = "/dev/no-such-port";
    EXPECT_THROW(Board board(make_serial_bus(settings)), std::runtime_error);
}

TEST(SerialBuses, WithoutAWatchdogTheyAreRefused) {
    PtyServos servos(SerialProtocol::feetech);
    SerialBusSettings settings;
    settings.protocol = SerialProtocol::feetech;
    settings.port = servos.port;
    settings.channels = {1};
    EXPECT_THROW(Board board(make_serial_bus(settings)), std::runtime_error);
    settings.need_watchdog = false;
    EXPECT_NO_THROW(Board board(make_serial_bus(settings)));
}

}  // namespace
}  // namespace palpate
