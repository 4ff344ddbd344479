#pragma once
// The other end of a serial line: a thread that answers like the servos of a bus, or like a Maestro's compact protocol.
// Strict: packets with a wrong checksum, ids that nobody has, and words into an answer that is still due are counted,
// and not obeyed.

#include <pty.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <map>
#include <mutex>
#include <set>
#include <stdexcept>
#include <thread>

#include "devices/drivers/maestro_protocol.h"
#include "devices/drivers/serial_protocol.h"
#include "tests/real_time.h"

namespace palpate::testing {

class ServoBusEmulator {
  public:
    using Clock = std::chrono::steady_clock;
    ServoBusEmulator(SerialProtocol protocol, const std::set<int>& ids)
        : protocol_(protocol), wide_(protocol == SerialProtocol::dynamixel) {
        char name[256];
        if (openpty(&master_, &slave_, name, nullptr, nullptr) != 0) throw std::runtime_error("no pty");
        port = name;
        for (int id : ids) {
            put(id, present(), wide_ ? 4 : 2, 2000);
            if (wide_) put(id, dynamixel::operating_mode, 1, dynamixel::plain_position);
        }
        ask_to_be_served_first();
        thread_ = std::thread([this] { serve(); });
    }
    ~ServoBusEmulator() {
        stop_ = true;
        thread_.join();
        ::close(master_);
        ::close(slave_);
    }
    std::string port;

    // What is wrong with the servos; set at any time.
    std::atomic<bool> silent{false};                       ///< nobody answers
    std::atomic<bool> echoes{false};                       ///< whoever speaks hears it, too, as on one wire
    std::atomic<bool> stubborn{false};                     ///< operating modes cannot be changed
    std::atomic<bool> forgets_watchdog{false};             ///< watchdogs cannot be set
    std::atomic<bool> bites{false};                        ///< watchdogs bite where they hear nothing
    std::atomic<bool> bite_now{false};                     ///< once: all watchdogs that are set bite; a Maestro's, too
    std::atomic<int> home{0};                              ///< of a Maestro's servos [quarter us]; 0: off
    std::atomic<bool> bites_unheard{false};                ///< the first answer that tells of a bite is lost
    std::atomic<int> errors_unheard{0};                    ///< so many answers that tell a Maestro's errors are lost
    std::atomic<int> dead{-1};                             ///< a servo that neither listens nor answers
    std::atomic<int> stuck{-1};                            ///< a servo that does not move
    std::atomic<int> error_of{-1}, error{0}, hardware{0};  ///< a servo, its error byte, its hardware error register
    std::atomic<int> answers_as{-1}, impostor{-1};         ///< a servo that answers under another's id

    // What was found wrong with what the program said.
    std::atomic<int> bad_checksums{0}, unknown_ids{0}, collisions{0};
    std::atomic<int> goals_after_bite{0}, goals_seen{0};
    std::atomic<double> slowest{0};  ///< how long a turn of this thread took, which should be some milliseconds [s]

    /// Newest targets of servos that were told any.
    std::map<int, int> goals() {
        const std::lock_guard lock(mutex_);
        return goals_;
    }
    /// A servo stands elsewhere: somebody has turned it.
    void turn(int id, int place) {
        const std::lock_guard lock(mutex_);
        put(id, present(), wide_ ? 4 : 2, place);
    }
    /// Its supply fails for a moment: what it was told since it last began is gone, what it keeps and its place are
    /// not.
    void restart(int id) {
        const std::lock_guard lock(mutex_);
        const int place = number(id, present(), wide_ ? 4 : 2);
        const auto from = memory_[id].begin();
        std::fill(from + (wide_ ? 64 : 40), from + (wide_ ? 160 : 56), std::uint8_t(0));
        put(id, goal(), wide_ ? 4 : 2, place);
        put(id, present(), wide_ ? 4 : 2, place);
    }
    /// A register as another program has left it.
    void keep(int id, int address, int value) {
        const std::lock_guard lock(mutex_);
        put(id, address, 1, value);
    }
    int get(int id, int address, int size = 1) {
        const std::lock_guard lock(mutex_);
        return number(id, address, size);
    }

  private:
    int present() const { return wide_ ? dynamixel::present_position : feetech::present_position; }
    int goal() const { return wide_ ? dynamixel::goal_position : feetech::goal_position; }
    int number(int id, int address, int size) {
        std::uint32_t v = 0;
        for (int k = 0; k < size; ++k) v |= std::uint32_t(memory_[id][std::size_t(address + k)]) << 8 * k;
        return int(v);
    }
    void put(int id, int address, int size, int value) {
        for (int k = 0; k < size; ++k) memory_[id][std::size_t(address + k)] = std::uint8_t(value >> 8 * k);
    }
    /// Answers come a moment later; whoever speaks in the meantime speaks into them.
    void say(const Bytes& bytes) {
        std::this_thread::sleep_for(std::chrono::microseconds(300));
        int waiting = 0;
        if (ioctl(master_, FIONREAD, &waiting) == 0 && waiting > 0 && !silent) ++collisions;
        if (!silent) [[maybe_unused]]
            const auto n = ::write(master_, bytes.data(), bytes.size());
    }
    void answer(int id, Bytes parameters) {
        if (id == dead) return;
        const int as = id == impostor ? answers_as.load() : id, e = id == error_of ? error.load() : 0;
        if (wide_) {
            parameters.insert(parameters.begin(), std::uint8_t(e));
            say(dynamixel::instruction(std::uint8_t(as), 0x55, parameters));
        } else {
            say(feetech::instruction(std::uint8_t(as), std::uint8_t(e), parameters));
        }
    }
    void serve() {
        play_a_controller();
        Bytes in;
        for (auto last = Clock::now(); !stop_;) {
            const auto now = Clock::now();
            slowest = std::max(slowest.load(), std::chrono::duration<double>(now - last).count());
            last = now;
            timeval wait{0, 5000};
            fd_set set;
            FD_ZERO(&set);
            FD_SET(master_, &set);
            const bool ready = ::select(master_ + 1, &set, nullptr, nullptr, &wait) > 0;
            const std::lock_guard lock(mutex_);
            let_watchdogs_bite();
            if (!ready) continue;
            std::uint8_t bytes[256];
            const auto n = ::read(master_, bytes, sizeof bytes);
            if (n > 0 && echoes) [[maybe_unused]]
                const auto echoed = ::write(master_, bytes, std::size_t(n));
            if (n > 0) in.insert(in.end(), bytes, bytes + n);
            while (protocol_ == SerialProtocol::maestro_compact ? take_compact(in) : take_packet(in)) {}
        }
    }
    void let_watchdogs_bite() {
        const bool now = bite_now.exchange(false);
        if (now && protocol_ == SerialProtocol::maestro_compact) {
            error = error | maestro::serial_timeout;
            errors_unheard = bites_unheard ? 1 : 0;
            bitten_ = true;
            for (auto& [channel, goal] : goals_) goal = home;
        }
        if (!(bites || now) || !wide_) return;
        const double silence = now ? 1e9 : std::chrono::duration<double>(Clock::now() - heard_).count();
        for (auto& [id, memory] : memory_)
            if (const int ticks = memory[dynamixel::bus_watchdog]; ticks > 0 && ticks < 0xFF && silence > 0.02 * ticks)
                memory[dynamixel::bus_watchdog] = 0xFF;
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
        goals_after_bite += bitten_ && (in[0] == 0x84 || in[0] == 0x9F);
        if (in[0] == 0x84) goals_[in[1]] = in[2] | in[3] << 7;
        if (in[0] == 0x9F)
            for (int k = 0; k < in[1]; ++k)
                goals_[in[2] + k] = in[std::size_t(3 + 2 * k)] | in[std::size_t(4 + 2 * k)] << 7;
        if (in[0] == 0x90) say({std::uint8_t(goals_[in[1]]), std::uint8_t(goals_[in[1]] >> 8)});
        if (in[0] == 0xA1) {
            const int errors = error.exchange(0);  // to tell them is to forget them
            if (errors_unheard > 0)
                --errors_unheard;
            else
                say({std::uint8_t(errors), 0});
        }
        return erase(in, need), true;
    }
    /// Takes one packet off the line, if there is a whole one.
    bool take_packet(Bytes& in) {
        const Bytes header = wide_ ? Bytes{0xFF, 0xFF, 0xFD, 0} : Bytes{0xFF, 0xFF};
        const std::size_t head = wide_ ? 7 : 4;
        if (in.size() < head) return false;
        if (!std::equal(header.begin(), header.end(), in.begin())) return ++bad_checksums, erase(in, 1), true;
        const std::size_t whole = head + (wide_ ? in[5] | in[6] << 8 : in[3]);
        if (in.size() < whole) return false;
        const int id = in[wide_ ? 4 : 2], what = in[wide_ ? 7 : 4];
        Bytes p(in.begin() + (wide_ ? 8 : 5), in.begin() + std::ptrdiff_t(whole) - (wide_ ? 2 : 1));
        const Bytes again = wide_ ? dynamixel::instruction(std::uint8_t(id), std::uint8_t(what), p)
                                  : feetech::instruction(std::uint8_t(id), std::uint8_t(what), p);
        const bool intact = std::equal(again.begin(), again.end(), in.begin(), in.begin() + std::ptrdiff_t(whole));
        erase(in, whole);
        if (!intact) return ++bad_checksums, true;
        heard_ = Clock::now();
        obey(id, what, p);
        return true;
    }
    int value_in(const Bytes& p, std::size_t at, std::size_t size) {
        std::uint32_t v = 0;
        for (std::size_t k = 0; k < size; ++k) v |= std::uint32_t(p[at + k]) << 8 * k;
        return int(v);
    }
    void obey(int id, int what, const Bytes& p) {
        const std::size_t a = wide_ ? 2 : 1;
        const int address = value_in(p, 0, a);
        if (what == 3 || what == 2) {
            if (!memory_.count(id)) return void(++unknown_ids);
            if (what == 3) {
                write(id, address, int(p.size() - a), value_in(p, a, p.size() - a));
                return answer(id, {});
            }
            return answer(id, bytes_of(id, address, value_in(p, a, a)));
        }
        const auto size = std::size_t(value_in(p, a, a));
        if (what == 0x83)
            for (std::size_t at = 2 * a; at + 1 + size <= p.size(); at += 1 + size)
                memory_.count(p[at]) ? write(p[at], address, int(size), value_in(p, at + 1, size))
                                     : void(++unknown_ids);
        if (what == 0x82)
            for (std::size_t at = 2 * a; at < p.size(); ++at)
                memory_.count(p[at]) ? answer(p[at], bytes_of(p[at], address, int(size))) : void(++unknown_ids);
    }
    Bytes bytes_of(int id, int address, int size) {
        if (wide_ && id == error_of) put(id, dynamixel::hardware_error, 1, hardware);
        const auto from = memory_[id].begin() + address;
        return Bytes(from, from + size);
    }
    void write(int id, int address, int size, int value) {
        if (id == dead) return;
        if (wide_ && memory_[id][dynamixel::bus_watchdog] == 0xFF && address != dynamixel::bus_watchdog) {
            if (address == goal()) ++goals_after_bite;
            return;  // it does not listen any more
        }
        if (stubborn && wide_ && address == dynamixel::operating_mode) return;
        if (forgets_watchdog && wide_ && address == dynamixel::bus_watchdog) return;
        put(id, address, size, value);
        if (address != goal()) return;
        ++goals_seen;
        goals_[id] = value;
        if (id != stuck) put(id, present(), size, value);
    }

    SerialProtocol protocol_;
    bool wide_, bitten_ = false;
    int master_ = -1, slave_ = -1;
    std::atomic<bool> stop_{false};
    std::mutex mutex_;
    std::map<int, int> goals_;
    std::map<int, std::array<std::uint8_t, 1024>> memory_;
    Clock::time_point heard_ = Clock::now();
    std::thread thread_;
};

}  // namespace palpate::testing
