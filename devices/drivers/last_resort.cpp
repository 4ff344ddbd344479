#include "devices/drivers/last_resort.h"

#include <cerrno>
#include <csignal>
#include <ctime>
#include <stdexcept>
#include <string>

namespace palpate {

namespace {

constexpr int deadly[] = {SIGABRT, SIGSEGV, SIGBUS,  SIGFPE,  SIGILL,    SIGSYS,  SIGTRAP, SIGQUIT,   SIGHUP,
                          SIGXCPU, SIGALRM, SIGUSR1, SIGUSR2, SIGVTALRM, SIGPROF, SIGPOLL, SIGSTKFLT, SIGPWR};
constexpr double step = 0.02, long_enough = 2;  ///< [s]

std::array<std::atomic<Board*>, RestOnDeath::at_most> boards{};
std::atomic<bool> entered{false};

/// However many signals come meanwhile.
void pause(double seconds) noexcept {
    timespec until{};
    ::clock_gettime(CLOCK_MONOTONIC, &until);
    const long ns = until.tv_nsec + long(1e9 * seconds);
    until.tv_sec += ns / 1'000'000'000, until.tv_nsec = ns % 1'000'000'000;
    while (::clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr) == EINTR) {}
}

}  // namespace

extern "C" void rest_then_die(int signal) {
    if (entered.exchange(true)) {
        pause(long_enough);  // another thread died first, and brings them to rest
    } else {
        for (auto& b : boards)
            if (Board* board = b) board->seize();
        bool moving = true;
        for (int k = 0; k < int(long_enough / step) && moving; ++k) {
            pause(step);
            moving = false;
            for (auto& b : boards)
                if (Board* board = b) moving |= board->rest_in_signal(step);
        }
    }
    std::signal(signal, SIG_DFL);
    std::raise(signal);  // comes as this handler returns
}

namespace {

/// A stack that has overflowed has no room for a handler: that of the thread that arms gets another.
void take_another_stack() {
    static std::array<char, 65536> room;
    stack_t now{};
    if (sigaltstack(nullptr, &now) != 0 || !(now.ss_flags & SS_DISABLE)) return;
    stack_t other{};
    other.ss_sp = room.data();
    other.ss_size = room.size();
    sigaltstack(&other, nullptr);
}

void take_signals() {
    take_another_stack();
    for (int signal : deadly) {
        struct sigaction now {};
        if (sigaction(signal, nullptr, &now) != 0 || now.sa_handler != SIG_DFL) continue;
        struct sigaction ours {};
        ours.sa_handler = rest_then_die;
        sigfillset(&ours.sa_mask);
        ours.sa_flags = SA_ONSTACK;
        sigaction(signal, &ours, nullptr);
    }
}

}  // namespace

RestOnDeath::RestOnDeath(std::shared_ptr<Board> board) : board_(std::move(board)) {
    take_signals();
    for (auto& slot : boards) {
        Board* none = nullptr;
        if (slot.compare_exchange_strong(none, board_.get())) return;
    }
    throw std::runtime_error("a program drives " + std::to_string(at_most) + " servo controllers at most");
}

RestOnDeath::~RestOnDeath() {
    for (auto& slot : boards)
        if (slot == board_.get()) slot = nullptr;
    if (entered) pause(2 * long_enough);  // this program is dying, of a signal that still needs the board
}

}  // namespace palpate
