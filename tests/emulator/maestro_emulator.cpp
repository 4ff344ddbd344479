// Emulates Pololu Maestro boards on USB for the unmodified program: runs a command that sees them, and writes down what
// they were told. usbfs by umockdev; what the boards do with it is here.
//
//   maestro-emulator [--boards N] [--channels N] [--watchdog MS] [--bites 1] [--home N] [--at N] [--log FILE]
//                    [--fault KIND@TRANSFER]... [--random-faults SEED] [--replug-ms MS] [--prompt 1]
//                    [--keeps-speed 0] [--slow-ms MS] [--another 1] [--swap 1] [--same 1]
//                    [--one-cpu 1] -- COMMAND...
//
// KIND: stall, timeout, partial (timeout with half the data), mute (obeyed, but nothing says so), short, long, errors
// (once), sticky (an error from then on), deaf (channel 1 refuses from then on), bite (the watchdog has bitten), unread
// (it has, and who asks for errors is refused once), race (it bites after errors were told, and before they are
// cleared), hang (never given back), unplug. With --bites 1 the watchdog bites by itself, where the board hears
// nothing. --at N [quarter us]: what servos were told before. --prompt 1: boards are served before other work.
// --keeps-speed 0: speed limits are taken, and read back as none. --slow-ms: so long each target takes. --another 1:
// what is plugged in again is another board. --swap 1: of two boards that are plugged in again, each is where the other
// was. --same 1: all have one serial number. --one-cpu 1: boards and command share a processor, so that a transfer
// takes what a bus takes (0.14 ms), and not what it takes to wake one processor from another four times (0.5 ms).
// Boards come and go with udev's events. The log is what wire_log.h reads. Exits as the command does.

#include <linux/ioctl.h>
#include <linux/usbdevice_fs.h>
#include <sched.h>
#include <sys/wait.h>
#include <umockdev.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstddef>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <deque>
#include <map>
#include <mutex>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include "tests/emulator/maestro_model.h"

namespace {

using Clock = std::chrono::steady_clock;

struct Options {
    int boards = 1, channels = 18, watchdog_ms = 200, replug_ms = 300, home = 0, at = 0, slow_ms = 0;
    bool bites = false, prompt = false, keeps_speed = true, another = false, one_cpu = false, swap = false,
         same = false;
    std::string log;
    std::map<long, std::string> faults;  ///< by number of the transfer
    std::vector<char*> command;
};

struct Urb {
    UMockdevIoctlData* data = nullptr;
    UMockdevIoctlData* buffer = nullptr;
    unsigned long address = 0;  ///< in the program
    int status = 0, length = 0;
    UMockdevIoctlClient* client = nullptr;  ///< whose it is: nobody else reaps it
};

struct Bus;

struct Board : palpate::testing::MaestroModel {
    Bus* bus = nullptr;
    bool present = true, listed = false, unread = false;  ///< on the bus; known to the system; refuses once
    bool race = false;                                    ///< bites as errors are cleared
    int plugged = 0;                                      ///< how often
    Clock::time_point gone;
    std::deque<Urb> finished, waiting;
    UMockdevIoctlBase* handler = nullptr;
    std::string node, path, text;
};

struct Bus {
    Options options;
    std::mutex mutex;
    UMockdevTestbed* testbed = nullptr;
    std::vector<Board> boards;
    long transfers = 0;
    FILE* log = nullptr;
};

std::string serial_of(int board) {
    char text[16];
    std::snprintf(text, sizeof text, "%08d", 123456 + board);
    return text;
}

std::string hex(const std::vector<int>& bytes) {
    std::string out;
    char two[3];
    for (int b : bytes) std::snprintf(two, sizeof two, "%02X", b & 0xff), out += two;
    return out;
}

/// What umockdev needs to know of a board.
std::string description(const Board& b) {
    const int product = b.channels == 6    ? 0x89
                        : b.channels == 12 ? 0x8a
                        : b.channels == 18 ? 0x8b
                        : b.channels == 24 ? 0x8c
                                           : 0x8e;
    const std::vector<int> descriptors{18,   1,    0x00, 0x02, 0xEF, 2, 1, 8, 0xfb, 0x1f, product, 0,
                                       0x04, 0x01, 1,    2,    3,    1, 9, 2, 18,   0,    1,       1,
                                       0,    0xC0, 50,   9,    4,    0, 0, 0, 0xff, 0,    0,       0};
    char text[1200];
    std::snprintf(text, sizeof text,
                  "P: /devices/pci0000:00/usb1/1-%d\nN: bus/usb/001/%03d\nE: DEVNAME=/dev/bus/usb/001/%03d\n"
                  "E: DEVTYPE=usb_device\nE: SUBSYSTEM=usb\nE: BUSNUM=001\nE: DEVNUM=%03d\nA: busnum=1\nA: devnum=%d\n"
                  "A: speed=12\nA: bConfigurationValue=1\nA: idVendor=1ffb\nA: idProduct=%04x\nH: descriptors=%s\n",
                  b.number + 1, b.number + 2, b.number + 2, b.number + 2, b.number + 2, product,
                  hex(descriptors).c_str());
    return text;
}

std::vector<std::uint8_t> string_descriptor(const Board& b, int index) {
    if (index == 0) return {4, 3, 0x09, 0x04};
    const Options& o = b.bus->options;
    const int number = (o.same                    ? 0
                        : o.swap && b.plugged > 1 ? 1 - b.number
                                                  : b.number) +
                       (o.another && b.plugged > 1 ? 100 : 0);
    const std::string text = index == 3 ? serial_of(number) : index == 2 ? "Maestro" : "Pololu";
    std::vector<std::uint8_t> out{std::uint8_t(2 + 2 * text.size()), 3};
    for (char c : text) out.push_back(std::uint8_t(c)), out.push_back(0);
    return out;
}

/// The watchdog, where it bites by itself.
void bite_if_starved(Board& b) {
    const Options& o = b.bus->options;
    if (o.bites && o.watchdog_ms > 0 && b.fed && Clock::now() - b.last_fed > std::chrono::milliseconds(o.watchdog_ms))
        bite(b);
}

/// The board's answer to a request; false: it stalls.
bool answer(Board& b, int type, int request, int value, int index, std::vector<std::uint8_t>& reply) {
    if (type == 0x80 && request == 6 && value >> 8 == 3) return reply = string_descriptor(b, value & 0xff), true;
    return palpate::testing::answer(b, type, request, value, index, reply);
}

void finish(Board& b, Urb urb, int status, int length) {
    urb.status = status;
    urb.length = length;
    b.finished.push_back(urb);
}

void unplug(Board& b) {
    b.present = false;
    b.gone = Clock::now();
    note(b, palpate::testing::unplugged, 0);
    for (Urb& u : b.waiting) finish(b, u, -ENODEV, 0);
    b.waiting.clear();
}

/// A control transfer comes in. Returns the errno of the ioctl, 0 where it was taken.
int submit(Board& b, Urb urb) {
    const int have = urb.buffer ? urb.buffer->data_len : 0;
    if (have < 8) return EINVAL;
    const std::uint8_t* setup = urb.buffer->data;
    const int type = setup[0], request = setup[1], value = setup[2] | setup[3] << 8, index = setup[4] | setup[5] << 8,
              wanted = setup[6] | setup[7] << 8;
    // A program that is stopped inside a call holds the emulation up, too: a board would have bitten meanwhile.
    bite_if_starved(b);
    const long number = b.bus->transfers++;
    const auto fault = b.bus->options.faults.find(number);
    const std::string kind = fault == b.bus->options.faults.end() ? "" : fault->second;
    if (kind == "unplug") return unplug(b), ENODEV;
    if (kind == "stall") return finish(b, urb, -EPIPE, 0), 0;
    if (kind == "timeout" || kind == "partial" || kind == "hang") {
        urb.length = kind == "partial" ? wanted / 2 : 0;
        urb.status = kind == "hang" ? 1 : 0;  // 1: not even cancelling brings it back
        b.waiting.push_back(urb);
        return 0;
    }
    if (b.bus->options.slow_ms > 0 && type == 0x40 && request == 0x85)
        std::this_thread::sleep_for(std::chrono::milliseconds(b.bus->options.slow_ms));
    if (kind == "mute") {
        std::vector<std::uint8_t> unheard;
        answer(b, type, request, value, index, unheard);
        return b.waiting.push_back(urb), 0;
    }
    if (kind == "errors") b.errors |= 1 << 4;
    if (kind == "sticky") b.sticky = true;
    if (kind == "deaf") b.deaf = true;
    if (kind == "bite" || kind == "unread") bite(b);
    b.unread |= kind == "unread";
    b.race |= kind == "race";
    if (b.race && request == 0x86) b.race = false, bite(b);
    if (b.unread && type == 0xC0 && request == 0x83) return b.unread = false, finish(b, urb, -EPIPE, 0), 0;
    std::vector<std::uint8_t> reply;
    if (!answer(b, type, request, value, index, reply)) return finish(b, urb, -EPIPE, 0), 0;
    if (kind == "long") return finish(b, urb, -EOVERFLOW, wanted), 0;
    int length = type & 0x80 ? std::min<int>(wanted, int(reply.size())) : wanted;
    if (kind == "short") length /= 2;
    if (type & 0x80 && length > 0) umockdev_ioctl_data_update(urb.buffer, 8, reply.data(), length);
    finish(b, urb, 0, length);
    return 0;
}

/// A board does not wait for what else a computer does: nor does the thread that emulates it, where that is allowed.
void come_before_other_work() {
    sched_param priority{};
    priority.sched_priority = 10;
    static_cast<void>(sched_setscheduler(0, SCHED_FIFO | SCHED_RESET_ON_FORK, &priority));
}

/// From now on this process, and what it starts, stays on the last processor that it may use.
void keep_to_one_cpu() {
    cpu_set_t allowed, one;
    if (sched_getaffinity(0, sizeof allowed, &allowed) != 0) return;
    CPU_ZERO(&one);
    for (int cpu = CPU_SETSIZE - 1; cpu >= 0 && CPU_COUNT(&one) == 0; --cpu)
        if (CPU_ISSET(cpu, &allowed)) CPU_SET(cpu, &one);
    static_cast<void>(sched_setaffinity(0, sizeof one, &one));
}

gboolean handle(UMockdevIoctlBase*, UMockdevIoctlClient* client, gpointer user) {
    Board& b = *static_cast<Board*>(user);
    [[maybe_unused]] static thread_local const bool first =
        (b.bus->options.prompt ? come_before_other_work() : void(), true);
    const std::lock_guard lock(b.bus->mutex);
    const unsigned long request = umockdev_ioctl_client_get_request(client);
    UMockdevIoctlData* arg = umockdev_ioctl_client_get_arg(client);
    auto complete = [&](long result, int error) { umockdev_ioctl_client_complete(client, result, error); };
    if (request == USBDEVFS_GET_CAPABILITIES) {
        UMockdevIoctlData* data = umockdev_ioctl_data_resolve(arg, 0, sizeof(std::uint32_t), nullptr);
        std::uint32_t caps = USBDEVFS_CAP_BULK_CONTINUATION;
        umockdev_ioctl_data_update(data, 0, reinterpret_cast<guint8*>(&caps), sizeof caps);
        complete(0, 0);
    } else if (request == USBDEVFS_SUBMITURB) {
        if (!b.present) return complete(-1, ENODEV), TRUE;
        Urb u;
        u.client = UMOCKDEV_IOCTL_CLIENT(g_object_ref(client));  // so that its address is not another's later
        u.data = umockdev_ioctl_data_resolve(arg, 0, sizeof(usbdevfs_urb), nullptr);
        const auto* urb = reinterpret_cast<const usbdevfs_urb*>(u.data->data);
        u.address = u.data->client_addr;
        u.buffer = umockdev_ioctl_data_resolve(u.data, offsetof(usbdevfs_urb, buffer), std::size_t(urb->buffer_length),
                                               nullptr);
        const int error = submit(b, u);
        complete(error ? -1 : 0, error);
    } else if (request == USBDEVFS_CONTROL) {
        if (!b.present) return complete(-1, ENODEV), TRUE;
        UMockdevIoctlData* data = umockdev_ioctl_data_resolve(arg, 0, sizeof(usbdevfs_ctrltransfer), nullptr);
        const auto* t = reinterpret_cast<const usbdevfs_ctrltransfer*>(data->data);
        std::vector<std::uint8_t> reply;
        const bool good = t->wLength == 0 && answer(b, t->bRequestType, t->bRequest, t->wValue, t->wIndex, reply);
        complete(good ? 0 : -1, good ? 0 : EPIPE);
    } else if (request == USBDEVFS_REAPURBNDELAY || request == USBDEVFS_REAPURB) {
        const auto own =
            std::find_if(b.finished.begin(), b.finished.end(), [&](const Urb& u) { return u.client == client; });
        if (own == b.finished.end()) return complete(-1, b.present ? EAGAIN : ENODEV), TRUE;
        Urb u = *own;
        b.finished.erase(own);
        int status = u.status, length = u.length;
        umockdev_ioctl_data_update(u.data, offsetof(usbdevfs_urb, status), reinterpret_cast<guint8*>(&status),
                                   sizeof status);
        umockdev_ioctl_data_update(u.data, offsetof(usbdevfs_urb, actual_length), reinterpret_cast<guint8*>(&length),
                                   sizeof length);
        UMockdevIoctlData* data = umockdev_ioctl_data_resolve(arg, 0, sizeof(void*), nullptr);
        umockdev_ioctl_data_set_ptr(data, 0, u.data);
        complete(0, 0);
    } else if (request == USBDEVFS_DISCARDURB) {
        for (auto it = b.waiting.begin(); it != b.waiting.end(); ++it) {
            if (it->client != client) continue;
            if (it->address != arg->client_addr && it->address != *reinterpret_cast<unsigned long*>(arg->data))
                continue;
            if (it->status == 1) return complete(0, 0), TRUE;
            finish(b, *it, -ENOENT, it->length);
            b.waiting.erase(it);
            return complete(0, 0), TRUE;
        }
        complete(-1, EINVAL);
    } else {
        complete(0, 0);  // configurations, interfaces: nothing to do
    }
    return TRUE;
}

bool plug_in(Bus& bus, Board& b) {
    GError* error = nullptr;
    if (!umockdev_testbed_add_from_string(bus.testbed, b.text.c_str(), &error) ||
        !umockdev_testbed_attach_ioctl(bus.testbed, b.node.c_str(), b.handler, &error)) {
        std::fprintf(stderr, "maestro-emulator: %s\n", error->message);
        return false;
    }
    b.present = b.listed = true;
    ++b.plugged;
    b.finished.clear();
    b.fed = false;
    umockdev_testbed_uevent(bus.testbed, b.path.c_str(), "add");
    note(b, palpate::testing::plugged_in, 0);
    return true;
}

/// udev tells that it is gone; then it is.
void pull_out(Bus& bus, Board& b) {
    umockdev_testbed_uevent(bus.testbed, b.path.c_str(), "remove");
    umockdev_testbed_detach_ioctl(bus.testbed, b.node.c_str(), nullptr);
    umockdev_testbed_remove_device(bus.testbed, b.path.c_str());
    b.listed = false;
}

bool parse(int argc, char** argv, Options& o) {
    static const char* kinds[] = {"stall",  "timeout", "partial", "short",  "long", "errors",
                                  "unplug", "bite",    "deaf",    "sticky", "hang", "mute"};
    for (int i = 1; i < argc; ++i) {
        const std::string arg = argv[i];
        if (arg == "--") {
            for (int k = i + 1; k < argc; ++k) o.command.push_back(argv[k]);
            o.command.push_back(nullptr);
            return o.command.size() > 1;
        }
        if (i + 1 >= argc) return false;
        const std::string value = argv[++i];
        if (arg == "--boards")
            o.boards = std::atoi(value.c_str());
        else if (arg == "--channels")
            o.channels = std::atoi(value.c_str());
        else if (arg == "--watchdog")
            o.watchdog_ms = std::atoi(value.c_str());
        else if (arg == "--home")
            o.home = std::atoi(value.c_str());
        else if (arg == "--at")
            o.at = std::atoi(value.c_str());
        else if (arg == "--bites")
            o.bites = value != "0";
        else if (arg == "--prompt")
            o.prompt = value != "0";
        else if (arg == "--keeps-speed")
            o.keeps_speed = value != "0";
        else if (arg == "--slow-ms")
            o.slow_ms = std::atoi(value.c_str());
        else if (arg == "--another")
            o.another = value != "0";
        else if (arg == "--swap")
            o.swap = value != "0";
        else if (arg == "--same")
            o.same = value != "0";
        else if (arg == "--one-cpu")
            o.one_cpu = value != "0";
        else if (arg == "--replug-ms")
            o.replug_ms = std::atoi(value.c_str());
        else if (arg == "--log")
            o.log = value;
        else if (arg == "--fault")
            o.faults[std::atol(value.substr(value.find('@') + 1).c_str())] = value.substr(0, value.find('@'));
        else if (arg == "--random-faults") {
            std::mt19937 random(unsigned(std::atol(value.c_str())));
            for (int k = 0; k < 12; ++k) o.faults[long(random() % 900)] = kinds[random() % std::size(kinds)];
        } else
            return false;
    }
    return false;
}

void stop_child(int) {}

}  // namespace

int main(int argc, char** argv) {
    Bus bus;
    if (!parse(argc, argv, bus.options)) {
        std::fprintf(stderr, "usage: see the head of maestro_emulator.cpp\n");
        return 2;
    }
    // udev's events can be sent from inside the mocked system only.
    if (const char* preloaded = std::getenv("LD_PRELOAD"); !preloaded || !std::strstr(preloaded, "umockdev")) {
        setenv("LD_PRELOAD", "libumockdev-preload.so.0", 1);
        execv("/proc/self/exe", argv);
    }
    if (bus.options.one_cpu) keep_to_one_cpu();
    if (!bus.options.log.empty()) bus.log = std::fopen(bus.options.log.c_str(), "w");
    bus.testbed = umockdev_testbed_new();
    bus.boards.resize(std::size_t(bus.options.boards));
    for (int i = 0; i < bus.options.boards; ++i) {
        Board& b = bus.boards[std::size_t(i)];
        b.bus = &bus;
        b.number = i;
        palpate::testing::set_up(b, bus.options.channels, bus.options.watchdog_ms, bus.options.home, bus.options.at);
        b.log = bus.log;
        b.keeps_speed = bus.options.keeps_speed;
        b.text = description(b);
        char node[64];
        std::snprintf(node, sizeof node, "/dev/bus/usb/001/%03d", i + 2);
        b.node = node;
        b.path = "/sys/devices/pci0000:00/usb1/1-" + std::to_string(i + 1);
        b.handler = umockdev_ioctl_base_new();
        g_signal_connect(b.handler, "handle-ioctl", G_CALLBACK(handle), &b);
        if (!plug_in(bus, b)) return 1;
    }
    const pid_t child = fork();
    if (child == 0) {
        execvp(bus.options.command[0], bus.options.command.data());
        std::fprintf(stderr, "maestro-emulator: cannot run %s\n", bus.options.command[0]);
        _exit(127);
    }
    for (int s : {SIGINT, SIGTERM}) std::signal(s, stop_child);  // the program ends first, then this
    int status = 0;
    for (auto turn = Clock::now(); waitpid(child, &status, WNOHANG) == 0;) {
        std::this_thread::sleep_for(std::chrono::milliseconds(2));
        const auto took = std::chrono::duration_cast<std::chrono::milliseconds>(Clock::now() - turn).count();
        turn += std::chrono::milliseconds(took);
        if (took > 15) {
            const std::lock_guard lock(bus.mutex);
            if (bus.boards[0].told) note(bus.boards[0], palpate::testing::stood_still, int(took));
        }
        for (Board& b : bus.boards) {
            std::unique_lock lock(bus.mutex);
            if (b.present) {
                bite_if_starved(b);
                continue;
            }
            const bool back =
                bus.options.replug_ms > 0 && Clock::now() - b.gone > std::chrono::milliseconds(bus.options.replug_ms);
            lock.unlock();
            if (b.listed) {
                pull_out(bus, b);
            } else if (back) {
                plug_in(bus, b);
            }
        }
    }
    if (bus.log) std::fclose(bus.log);
    return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
}
