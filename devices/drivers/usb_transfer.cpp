#include "devices/drivers/usb_transfer.h"

#include <algorithm>
#include <stdexcept>

namespace palpate::usb {

namespace {

/// On the heap, so that what USB never gives back may outlive everything.
struct Waiting {
    libusb_transfer* transfer = libusb_alloc_transfer(0);
    std::vector<unsigned char> buffer;
    bool done = false;
    ~Waiting() { libusb_free_transfer(transfer); }
};

void LIBUSB_CALL finished(libusb_transfer* t) { static_cast<Waiting*>(t->user_data)->done = true; }

int error_of(libusb_transfer_status status) {
    switch (status) {
        case LIBUSB_TRANSFER_COMPLETED:
            return 0;
        case LIBUSB_TRANSFER_TIMED_OUT:
        case LIBUSB_TRANSFER_CANCELLED:
            return LIBUSB_ERROR_TIMEOUT;
        case LIBUSB_TRANSFER_STALL:
            return LIBUSB_ERROR_PIPE;
        case LIBUSB_TRANSFER_NO_DEVICE:
            return LIBUSB_ERROR_NO_DEVICE;
        case LIBUSB_TRANSFER_OVERFLOW:
            return LIBUSB_ERROR_OVERFLOW;
        default:
            return LIBUSB_ERROR_IO;
    }
}

}  // namespace

std::string problem_of(int rc) {
    const std::string what = libusb_strerror(rc);
    switch (rc) {
        case LIBUSB_ERROR_ACCESS:
            return "no permission to open it: `palpate doctor` says how to get it";
        case LIBUSB_ERROR_NO_DEVICE:
            return "it was unplugged: plug it in, and look at cable and hub";
        case LIBUSB_ERROR_BUSY:
            return "another program uses it: end that one (Maestro Control Center, a virtual machine)";
        case LIBUSB_ERROR_TIMEOUT:
            return what + ": it does not answer; unplug it, plug it in again, without a hub";
        case LIBUSB_ERROR_PIPE:
            return what + ": it refuses a request that every Maestro knows; unplug it, plug it in again";
        case LIBUSB_ERROR_IO:
        case LIBUSB_ERROR_OVERFLOW:
            return what + ": USB is disturbed; look at cable, hub and ground of the servos' supply";
        case LIBUSB_ERROR_NO_MEM:
            return what + ": the system has no memory left for USB; end other programs";
        default:
            return what + ": unplug it, plug it in again";
    }
}

Context::Context() {
    const int rc = libusb_init(&raw_);
    if (rc != 0) throw std::runtime_error(std::string("USB cannot be used: ") + libusb_strerror(rc));
}

Context::~Context() {
    if (!stuck) libusb_exit(raw_);
}

std::vector<std::uint8_t> transfer(const Handle& handle, const maestro::Request& r, bool any_length) {
    Context& context = handle.context();
    if (context.stuck) throw std::runtime_error("USB does not give transfers back");
    auto waiting = std::make_unique<Waiting>();
    waiting->buffer.resize(LIBUSB_CONTROL_SETUP_SIZE + r.length);
    libusb_fill_control_setup(waiting->buffer.data(), r.type, r.request, r.value, r.index, r.length);
    libusb_fill_control_transfer(waiting->transfer, handle.get(), waiting->buffer.data(), finished, waiting.get(),
                                 timeout_ms);
    if (const int rc = libusb_submit_transfer(waiting->transfer); rc != 0) throw std::runtime_error(problem_of(rc));
    auto done = [&] { return waiting->done; };
    if (!context.wait(done, int(timeout_ms) + 20)) {
        libusb_cancel_transfer(waiting->transfer);
        if (!context.wait(done, 50)) {
            context.stuck = true;
            static_cast<void>(waiting.release());
            throw std::runtime_error("USB does not give transfers back: unplug it, plug it in again, without a hub");
        }
    }
    if (const int rc = error_of(waiting->transfer->status); rc != 0) throw std::runtime_error(problem_of(rc));
    const int n = waiting->transfer->actual_length;
    if (n != r.length && !any_length)
        throw std::runtime_error("a reply of " + std::to_string(n) + " bytes where " + std::to_string(r.length) +
                                 " were expected");
    const auto first = waiting->buffer.begin() + LIBUSB_CONTROL_SETUP_SIZE;
    return {first, first + std::clamp(n, 0, int(r.length))};
}

std::string string_of(const Handle& handle, std::uint8_t index) {
    if (index == 0) return "";
    constexpr std::uint8_t get_descriptor = 6, strings = 3;
    auto ask = [&](std::uint8_t which, std::uint16_t language) {
        return transfer(handle, {0x80, get_descriptor, std::uint16_t(strings << 8 | which), language, 255}, true);
    };
    const auto languages = ask(0, 0);
    if (languages.size() < 4) throw std::runtime_error("it has no strings: unplug it, plug it in again");
    const auto reply = ask(index, std::uint16_t(languages[2] | languages[3] << 8));
    if (reply.size() < 2 || reply[1] != strings) throw std::runtime_error(problem_of(LIBUSB_ERROR_IO));
    std::string text;
    for (std::size_t k = 2; k + 1 < std::min<std::size_t>(reply.size(), reply[0]); k += 2)
        text += reply[k + 1] == 0 && reply[k] < 128 ? char(reply[k]) : '?';
    return text;
}

}  // namespace palpate::usb
