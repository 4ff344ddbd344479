// Servos on serial lines: protocols against their published examples, noise and pieces, and buses on pseudo-terminals.

#include <pty.h>
#include <unistd.h>

#include <map>
#include <thread>

#include "devices/drivers/serial_bus.h"
#include "devices/drivers/serial_protocol.h"
#include "tests/support.h"

namespace palpate {
namespace {

using testing::eventually;

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
    // The same packet for the current limits of two servos: register 102, two bytes each.
    const Bytes currents = dynamixel::write_torques(goals);
    EXPECT_EQ(Bytes(currents.begin(), currents.end() - 2),
              (Bytes{0xFF, 0xFF, 0xFD, 0x00, 0xFE, 0x0D, 0x00, 0x83, 0x66, 0x00, 0x02, 0x00, 0x01, 0x96, 0x00, 0x02,
                     0xAA, 0x00}));
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
    std::atomic<bool> stubborn{false};  ///< keeps its operating mode

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
        if (what == 3 && !(stubborn && number(0, a) == dynamixel::operating_mode))
            registers_[{id, number(0, a)}] = number(a, p.size() - a);
        if (wide && what == 2) say(dynamixel_status(id, {std::uint8_t(registers_[{id, number(0, a)}])}));
        const int register_of_all = what == 0x83 ? p[0] : 0;
        if (what == 0x83 && (register_of_all == dynamixel::goal_current || register_of_all == feetech::torque_limit))
            for (std::size_t at = 2 * a; at + 3 <= p.size(); at += 3)
                registers_[{p[at], register_of_all}] = number(at + 1, 2);
        else if (what == 0x83)
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

TEST_P(SerialBuses, TorqueLimitsArriveBeforeTargets) {
    if (GetParam() == SerialProtocol::maestro_compact) GTEST_SKIP() << "hobby servos have no torque limit";
    PtyServos servos(GetParam());
    SerialBusSettings settings;
    settings.protocol = GetParam();
    settings.port = servos.port;
    settings.channels = settings.force_channels = {4, 5};
    settings.need_watchdog = false;
    const int where = GetParam() == SerialProtocol::dynamixel ? dynamixel::goal_current : feetech::torque_limit;
    {
        const ServoCalibration servo{2048, 651.9, 1024, 3072, 2827, 800};
        auto board = std::make_shared<Board>(make_serial_bus(settings));
        const auto driver = make_board_driver(board, {4, 5}, {servo, servo}, 6);
        if (GetParam() == SerialProtocol::dynamixel) {
            EXPECT_EQ(servos.registers().at({4, dynamixel::operating_mode}), 5);
            EXPECT_EQ(servos.registers().at({4, where}), 0) << "no force before the first limit";
        }
        ASSERT_TRUE(driver->limit_torque(Eigen::Vector2d(0.1, 5.0)));
        driver->send(Eigen::Vector2d(0, 0.05), 0);
        EXPECT_TRUE(eventually([&] { return servos.goals().count(5) == 1; }));
        EXPECT_EQ(servos.registers().at({4, where}), 283);
        EXPECT_EQ(servos.registers().at({5, where}), 800);
        ASSERT_TRUE(driver->limit_torque(Eigen::Vector2d(NAN, 0)));
        driver->send(Eigen::Vector2d(0, 0.05), 0.02);
        EXPECT_TRUE(eventually([&] { return servos.registers().at({4, where}) == 0; }));
        const ServoCalibration hobby;
        EXPECT_FALSE(make_board_driver(board, {6}, {hobby}, 6)->limit_torque(Coordinates::Ones(1)));
    }
    if (GetParam() != SerialProtocol::dynamixel) return;
    EXPECT_TRUE(eventually([&] { return servos.registers().at({4, dynamixel::operating_mode}) == 3; }));
    EXPECT_EQ(servos.registers().at({4, dynamixel::torque_enable}), 0);
    servos.stubborn = true;
    try {
        Board board(make_serial_bus(settings));
        FAIL() << "a servo without the mode was taken";
    } catch (const std::runtime_error& error) {
        EXPECT_NE(std::string(error.what()).find("current-based position"), std::string::npos) << error.what();
    }
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
