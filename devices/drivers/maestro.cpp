#include "devices/drivers/maestro.h"

#include <linux/ioctl.h>

#include <linux/usbdevice_fs.h>
#include <sys/ioctl.h>
#include <sys/time.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstring>
#include <stdexcept>
#include <thread>

#include "devices/drivers/device_lock.h"
#include "devices/drivers/maestro_protocol.h"
#include "devices/drivers/usb_transfer.h"
#include "devices/loop/clock.h"

namespace palpate::maestro {

namespace {

using usb::Context;
using usb::Handle;
using usb::timeout_ms;
using usb::transfer;

/// A board of which transfers never come back leaves a little behind at each attempt; so many are enough.
constexpr int stuck_at_most = 20;

const LinkProblem held_up{"transfers to the Maestro were held up", false, FaultKind::silent};
const LinkProblem bitten{"the Maestro's watchdog has bitten: its servos went home", true, FaultKind::watchdog};
const LinkProblem another_length{"the Maestro answered with a reply of another length", false, FaultKind::bad_reply};

int parameter(const Handle& handle, int which, int bytes) {
    const auto reply = transfer(handle, get_parameter(which, bytes));
    return bytes == 1 ? reply[0] : reply[0] | reply[1] << 8;
}

std::vector<std::uint8_t> servo_settings(const Handle& handle, int channels) {
    return transfer(handle, channels == 6 ? get_variables(6) : get_servo_settings(channels));
}

void ask(const Handle& handle, BoardInfo& info) {
    info.watchdog_ms = 10 * parameter(handle, serial_timeout_parameter, 2);
    const auto variables = parse_variables(info.channels, transfer(handle, get_variables(info.channels)));
    if (variables) info.errors = describe_errors(variables->errors);
    const auto settings = servo_settings(handle, info.channels);
    for (int c = 0; c < info.channels; ++c) {
        BoardInfo::Channel channel;
        if (const auto s = parse_servo(info.channels, c, settings)) channel.position = s->position;
        channel.min_us = 16.0 * parameter(handle, min_parameter(c), 1);
        channel.max_us = 16.0 * parameter(handle, max_parameter(c), 1);
        channel.home = parameter(handle, home_parameter(c), 2);
        info.servos.push_back(channel);
    }
}

/// What a device is, if it is a board; with its handle, where it could be opened.
std::optional<BoardInfo> identify(Context& context, libusb_device* device, Handle& handle) {
    libusb_device_descriptor d;
    if (libusb_get_device_descriptor(device, &d) != 0 || d.idVendor != vendor) return std::nullopt;
    const auto channels = channels_of_product(d.idProduct);
    if (!channels) return std::nullopt;
    BoardInfo info;
    info.bus = libusb_get_bus_number(device);
    info.address = libusb_get_device_address(device);
    info.channels = *channels;
    info.product = *channels ? "Maestro " + std::to_string(*channels) : "Maestro in its bootloader";
    char firmware[16];
    std::snprintf(firmware, sizeof firmware, "%x.%02x", unsigned(d.bcdDevice) >> 8, unsigned(d.bcdDevice) & 0xff);
    info.firmware = firmware;
    libusb_device_handle* raw = nullptr;
    const int rc = libusb_open(device, &raw);
    if (rc != 0) {
        info.denied = rc == LIBUSB_ERROR_ACCESS;
        info.problem = usb::problem_of(rc);
        return info;
    }
    handle = Handle(context, raw);
    try {
        info.serial = usb::string_of(handle, d.iSerialNumber);
    } catch (const std::exception& error) {
        info.problem = std::string("its serial number cannot be read: ") + error.what();
    }
    return info;
}

/// Calls visit(info, handle) for every board.
template <class Visit>
void each_board(Context& context, Visit visit) {
    libusb_device** list = nullptr;
    const auto count = libusb_get_device_list(context.get(), &list);
    if (count < 0) throw std::runtime_error(std::string("USB cannot be listed: ") + libusb_strerror(int(count)));
    for (std::ptrdiff_t i = 0; i < count; ++i) {
        Handle handle;
        if (auto info = identify(context, list[i], handle)) visit(*info, handle);
    }
    libusb_free_device_list(list, 1);
}

/// The board with a serial number, or the only one. Throws what is wrong.
std::pair<BoardInfo, Handle> open_board(Context& context, const std::string& serial) {
    std::pair<BoardInfo, Handle> found;
    std::string others, problems;
    int fitting = 0;
    each_board(context, [&](BoardInfo& info, Handle& handle) {
        if (!info.problem.empty())
            problems += "; a board at bus " + std::to_string(info.bus) + " address " + std::to_string(info.address) +
                        ": " + info.problem;
        others += (others.empty() ? "" : ", ") + (info.serial.empty() ? "?" : info.serial) +
                  (info.channels ? "" : " (in its bootloader)");
        if (!handle || !info.problem.empty() || info.channels == 0) return;
        if (!serial.empty() && info.serial != serial) return;
        ++fitting;
        found = {info, std::move(handle)};
    });
    const std::string wanted = serial.empty() ? "a Maestro" : "the Maestro " + serial;
    if (fitting == 0)
        throw std::runtime_error(wanted + " was not found; on USB: " + (others.empty() ? "none" : others) + problems);
    if (fitting > 1 && !serial.empty())
        throw std::runtime_error("several Maestros have the serial number " + serial +
                                 ", and nothing else tells which is which: leave one of them plugged in");
    if (fitting > 1)
        throw std::runtime_error("several Maestros are on USB (" + others +
                                 "); say which by serial = \"...\" in the device");
    return found;
}

std::string node_of(const BoardInfo& info) {
    char node[40];
    std::snprintf(node, sizeof node, "/dev/bus/usb/%03d/%03d", info.bus, info.address);
    return node;
}

class MaestroLink final : public BoardLink {
  public:
    explicit MaestroLink(LinkSettings settings) : settings_(std::move(settings)) { recalls = true; }
    ~MaestroLink() override { close(); }

    std::string open(std::span<WireValue> positions) override try {
        close();
        if (stuck_ >= stuck_at_most)
            throw std::runtime_error("USB does not give transfers to the Maestro back: start this program again");
        homes_.clear();
        told_.fill(no_pulse);
        context_ = std::make_unique<Context>();  // a fresh one: an old one may not see a board that came back
        auto [info, handle] = open_board(*context_, settings_.serial);
        handle_ = std::move(handle);
        channels_ = info.channels;
        lock_.take(node_of(info), "the Maestro " + info.serial);
        check_watchdog(info.serial);
        for (const auto& [channel, limits] : settings_.limits)
            if (channel >= channels_)
                throw std::runtime_error("channel " + std::to_string(channel) + " is not one of the " +
                                         std::to_string(channels_) + " of the Maestro " + info.serial);
        set_limits();
        // Before it is asked where servos are: a watchdog that bites after this is seen when it is fed.
        transfer(handle_, clear_errors());
        const auto reply = servo_settings(handle_, channels_);
        for (int c = 0; c < channels_; ++c)
            if (const auto s = parse_servo(channels_, c, reply)) {
                positions[std::size_t(c)] = s->position;
                check_limits(c, *s);
            }
        settings_.serial = info.serial;  // what comes back after a fault has to be this one
        return "";
    } catch (const std::exception& error) {
        close();
        return error.what();
    }

    void close() override {
        stuck_ += context_ && context_->stuck;
        // Transfers hold on to the device, and the device to the context.
        for (Pending& p : *pending_) p.free();
        handle_.reset();
        context_.reset();
        lock_.release();
    }

    LinkProblem write(std::span<const ChannelTarget> targets, std::span<Transfer> transfers) override {
        const LinkProblem problem = send_all(
            targets.size(), [&](std::size_t i) { return set_target(targets[i].channel, targets[i].value); }, transfers);
        for (std::size_t i = 0; i < targets.size(); ++i)
            told_[std::size_t(targets[i].channel)] = transfers[i].arrived > 0 ? targets[i].value : no_pulse;
        return problem;
    }

    LinkProblem recall(std::span<const int> channels, std::span<WireValue> held) override {
        if (const auto p = send(channels_ == 6 ? get_variables(6) : get_servo_settings(channels_))) return p;
        for (const int c : channels) {
            const auto servo = parse_servo(channels_, c, reply());
            if (!servo) return another_length;
            held[std::size_t(c)] = servo->target;
        }
        return {};
    }

    LinkProblem feed() override {
        // Clearing errors feeds the watchdog, and forgets that it has bitten: they are cleared by who has read them.
        const double began = device_clock();
        if (const auto p = send(get_variables(channels_))) return p;
        const auto variables = parse_variables(channels_, reply());
        if (!variables) return another_length;
        // Errors were cleared as it was opened: this one came since.
        if (variables->errors & serial_timeout) return bitten;
        if (device_clock() - began > ask_first_after) return held_up;
        if (const auto p = send(clear_errors())) return p;
        if (const auto p = look_for_bite()) return p;
        const std::string errors = describe_errors(variables->errors);
        if (errors.empty()) return {};
        return {"the Maestro reports errors: " + errors, false, FaultKind::reported};
    }

    LinkProblem limit_speed(double share) override {
        std::array<Request, max_channels> requests;
        std::array<Transfer, max_channels> transfers;
        std::size_t count = 0;
        for (const auto& [channel, limits] : settings_.limits)
            if (limits.speed > 0) requests[count++] = set_speed(channel, speed_units(share * limits.speed));
        return send_all(
            count, [&](std::size_t i) { return requests[i]; }, transfers);
    }

    bool write_in_signal(std::span<const ChannelTarget> targets) noexcept override {
        for (const auto& [channel, value] : targets) {
            const Request r = set_target(channel, value);
            usbdevfs_ctrltransfer t{r.type, r.request, r.value, r.index, 0, 20, nullptr};
            if (::ioctl(lock_.fd(), USBDEVFS_CONTROL, &t) < 0) return false;
        }
        return true;
    }

  private:
    static constexpr int longest_reply = 192;
    struct Pending {
        libusb_transfer* transfer = nullptr;
        unsigned char buffer[LIBUSB_CONTROL_SETUP_SIZE + longest_reply];
        bool done = true;
        double done_at = 0;  ///< [s]
        void free() {
            libusb_free_transfer(transfer);
            transfer = nullptr;
        }
        ~Pending() { free(); }
    };
    static void LIBUSB_CALL finished(libusb_transfer* t) {
        auto& pending = *static_cast<Pending*>(t->user_data);
        pending.done = true;
        pending.done_at = device_clock();
    }

    static std::uint16_t speed_units(double us_per_s) {
        return std::uint16_t(std::clamp(std::ceil(us_per_s / 25), 1.0, 16383.0));  // 0.25 us / 10 ms
    }
    /// 0, none, where more is asked for than the board can count.
    static std::uint8_t acceleration_units(double us_per_s2) {
        const double units = std::ceil(us_per_s2 / 312.5);  // 0.25 us / 10 ms / 80 ms
        return units <= 255 ? std::uint8_t(std::max(0.0, units)) : std::uint8_t(0);
    }
    void check_watchdog(const std::string& serial);
    LinkProblem look_for_bite();
    void set_limits();
    void check_limits(int channel, const ServoSetting& found) const;
    template <class RequestOf>
    LinkProblem send_all(std::size_t count, RequestOf request_of, std::span<Transfer> transfers);
    LinkProblem send(const Request& request) {
        Transfer transfer;
        return send_all(
            1, [&](std::size_t) { return request; }, std::span(&transfer, 1));
    }
    /// What the last request that was sent by itself brought.
    std::span<const std::uint8_t> reply() const {
        const Pending& p = (*pending_)[0];
        return {p.buffer + LIBUSB_CONTROL_SETUP_SIZE, std::size_t(p.transfer->actual_length)};
    }
    bool wait_for_all(std::size_t count, int milliseconds);
    static LinkProblem problem_of(int channel_index, const libusb_transfer& t);

    LinkSettings settings_;
    std::unique_ptr<Context> context_;
    Handle handle_;
    DeviceLock lock_;
    int channels_ = 0;
    std::map<int, int> homes_;                    ///< where a watchdog that bites leaves servos; 0: off
    std::array<WireValue, max_channels> told_{};  ///< what surely arrived; no_pulse: nothing, or nobody knows
    int stuck_ = 0;                               ///< contexts that were left behind
    /// On the heap, so that what USB never gives back may outlive the link.
    std::unique_ptr<std::array<Pending, max_channels>> pending_ = std::make_unique<std::array<Pending, max_channels>>();
};

void MaestroLink::check_watchdog(const std::string& serial) {
    if (!settings_.need_watchdog) return;
    for (const auto& [channel, limits] : settings_.limits)
        if (channel < channels_) homes_[channel] = parameter(handle_, home_parameter(channel), 2);
    const int watchdog = 10 * parameter(handle_, serial_timeout_parameter, 2);
    const std::string problem = watchdog_problem(watchdog, homes_);
    if (!problem.empty())
        throw std::runtime_error("the Maestro " + serial + ": " + problem +
                                 " if this program were killed; `palpate doctor SCENE --mend` mends it, "
                                 "--no-watchdog goes on without");
}

/// A watchdog that bit after errors were read, and before they were cleared, has left no word, but servos at home.
LinkProblem MaestroLink::look_for_bite() {
    if (std::all_of(told_.begin(), told_.end(), [](WireValue v) { return v == no_pulse; })) return {};
    if (const auto p = send(channels_ == 6 ? get_variables(6) : get_servo_settings(channels_))) return p;
    for (int c = 0; c < channels_; ++c) {
        const WireValue told = told_[std::size_t(c)];
        const auto servo = parse_servo(channels_, c, reply());
        if (!servo) return another_length;
        if (told == no_pulse || servo->target == told) continue;
        const auto home = homes_.find(c);
        if (servo->target == no_pulse || (home != homes_.end() && servo->target == home->second)) return bitten;
    }
    return {};
}

/// For the first move, and for those after it.
void MaestroLink::set_limits() {
    for (const auto& [channel, limits] : settings_.limits) {
        if (limits.speed > 0) transfer(handle_, set_speed(channel, speed_units(first_move_share * limits.speed)));
        if (limits.acceleration > 0)
            transfer(handle_, set_acceleration(channel, acceleration_units(limits.acceleration)));
    }
}

/// Limits as they read back.
void MaestroLink::check_limits(int channel, const ServoSetting& found) const {
    const auto set = settings_.limits.find(channel);
    if (set == settings_.limits.end()) return;
    const auto& [speed, acceleration] = set->second;
    if ((speed > 0 && found.speed != speed_units(first_move_share * speed)) ||
        (acceleration > 0 && found.acceleration != acceleration_units(acceleration)))
        throw std::runtime_error("the Maestro does not keep the speed limit of channel " + std::to_string(channel) +
                                 ": it reads back as " + std::to_string(found.speed));
}

bool MaestroLink::wait_for_all(std::size_t count, int milliseconds) {
    return context_->wait(
        [&] {
            return std::all_of(pending_->begin(), pending_->begin() + std::ptrdiff_t(count),
                               [](const Pending& p) { return p.done; });
        },
        milliseconds);
}

LinkProblem MaestroLink::problem_of(int which, const libusb_transfer& t) {
    const std::string transfer = "transfer " + std::to_string(which);
    switch (t.status) {
        case LIBUSB_TRANSFER_COMPLETED:
            return {};
        case LIBUSB_TRANSFER_NO_DEVICE:
            return {"the Maestro was unplugged", true, FaultKind::unplugged};
        case LIBUSB_TRANSFER_STALL:
            return {"the Maestro refused " + transfer, false, FaultKind::refused};
        case LIBUSB_TRANSFER_TIMED_OUT:
        case LIBUSB_TRANSFER_CANCELLED:
            return {"the Maestro did not answer " + transfer + " in time", false, FaultKind::silent};
        case LIBUSB_TRANSFER_OVERFLOW:
            return {"the Maestro answered " + transfer + " with more than was asked for", false, FaultKind::bad_reply};
        default:
            return {transfer + " to the Maestro failed", false, FaultKind::other};
    }
}

template <class RequestOf>
LinkProblem MaestroLink::send_all(std::size_t count, RequestOf request_of, std::span<Transfer> transfers) {
    if (!handle_ || context_->stuck) return {"the Maestro is not open", true, FaultKind::unplugged};
    LinkProblem problem;
    std::size_t submitted = 0;
    const double began = device_clock();
    for (std::size_t i = 0; i < count; ++i) {
        if (device_clock() - began > ask_first_after) {
            problem = held_up;
            break;
        }
        Pending& p = (*pending_)[i];
        if (!p.transfer) p.transfer = libusb_alloc_transfer(0);
        const Request r = request_of(i);
        libusb_fill_control_setup(p.buffer, r.type, r.request, r.value, r.index, r.length);
        libusb_fill_control_transfer(p.transfer, handle_.get(), p.buffer, finished, &p, timeout_ms);
        p.done = false;
        transfers[i] = {device_clock(), 0};
        const int rc = libusb_submit_transfer(p.transfer);
        if (rc != 0) {
            p.done = true;
            const bool gone = rc == LIBUSB_ERROR_NO_DEVICE;
            problem = {gone ? "the Maestro was unplugged" : usb::problem_of(rc), gone,
                       gone ? FaultKind::unplugged : FaultKind::other};
            break;
        }
        ++submitted;  // what is done is looked at below: the last of them must not wait for that
    }
    if (!wait_for_all(submitted, int(timeout_ms) + 20)) {
        for (std::size_t i = 0; i < submitted; ++i)
            if (!(*pending_)[i].done) libusb_cancel_transfer((*pending_)[i].transfer);
        if (!wait_for_all(submitted, 50)) {
            context_->stuck = true;
            static_cast<void>(pending_.release());  // see close()
            pending_ = std::make_unique<std::array<Pending, max_channels>>();
            return {"USB does not give the transfers to the Maestro back", true, FaultKind::silent};
        }
    }
    for (std::size_t i = 0; i < submitted; ++i) {
        const libusb_transfer& t = *(*pending_)[i].transfer;
        if (t.status == LIBUSB_TRANSFER_COMPLETED) transfers[i].arrived = (*pending_)[i].done_at;
        if (const LinkProblem p = problem_of(int(i), t); p && (!problem || p.lost)) problem = p;
    }
    return problem;
}

}  // namespace

std::vector<BoardInfo> find_boards() {
    Context context;
    std::vector<BoardInfo> boards;
    each_board(context, [&](BoardInfo& info, Handle& handle) {
        if (handle && info.channels > 0 && info.problem.empty()) try {
                ask(handle, info);
            } catch (const std::exception& error) { info.problem = std::string("it does not answer: ") + error.what(); }
        boards.push_back(info);
    });
    return boards;
}

std::string watchdog_problem(int watchdog_ms, const std::map<int, int>& homes) {
    if (watchdog_ms == 0) return "its watchdog is off: servos would hold their force";
    if (watchdog_ms > longest_watchdog_ms)
        return "its watchdog waits " + std::to_string(watchdog_ms) + " ms, and may wait " +
               std::to_string(longest_watchdog_ms) + " at most: servos would hold their force for so long";
    for (const auto& [channel, home] : homes)
        if (home == home_ignore)
            return "the home of channel " + std::to_string(channel) +
                   " is \"ignore\": its watchdog would leave the servo as it is";
    return "";
}

std::string set_watchdog(const std::string& serial, int timeout) try {
    Context context;
    auto [info, handle] = open_board(context, serial);
    DeviceLock lock;
    lock.take(node_of(info), "the Maestro " + info.serial);
    for (int c = 0; c < info.channels; ++c)
        if (parameter(handle, home_parameter(c), 2) == home_ignore)
            transfer(handle, set_parameter(home_parameter(c), 2, 0));
    const auto value = std::uint16_t(std::clamp((timeout + 9) / 10, 1, 65535));
    transfer(handle, set_parameter(serial_timeout_parameter, 2, value));
    transfer(handle, reinitialise());
    std::this_thread::sleep_for(std::chrono::milliseconds(60));  // the board needs 50
    const int now = parameter(handle, serial_timeout_parameter, 2);
    return now == value ? "" : "the watchdog reads back as " + std::to_string(10 * now) + " ms";
} catch (const std::exception& error) { return error.what(); }

std::unique_ptr<BoardLink> make_link(const LinkSettings& settings) { return std::make_unique<MaestroLink>(settings); }

}  // namespace palpate::maestro
