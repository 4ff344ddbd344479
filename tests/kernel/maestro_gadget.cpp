// A Maestro behind a real kernel's USB: FunctionFS on dummy_hcd. maestro_gadget FFS UDC_FILE UDC LOG PLAN...
//
// FFS: where FunctionFS is mounted; UDC_FILE: the gadget's UDC in configfs. Each of PLAN is SECONDS:EVENT after the
// board was first told anything: unplug, replug, hang (does not answer for half a second), stall (the next request),
// bite (the watchdog). Writes what wire_log.h reads.

#include <endian.h>
#include <fcntl.h>
#include <linux/usb/functionfs.h>
#include <poll.h>
#include <unistd.h>

#include <atomic>
#include <cstring>
#include <mutex>
#include <string>
#include <thread>

#include "tests/emulator/maestro_model.h"

namespace {

using namespace palpate::testing;

#pragma pack(push, 1)
struct Descriptors {
    usb_functionfs_descs_head_v2 head;
    std::uint32_t full_speed_count, high_speed_count;
    struct Set {
        usb_interface_descriptor interface;
        usb_endpoint_descriptor_no_audio endpoint;
    } full_speed, high_speed;
};
struct Strings {
    usb_functionfs_strings_head head;
    std::uint16_t language;
    char text[8];
};
#pragma pack(pop)

bool describe(int ep0) {
    Descriptors d{};
    d.head.magic = htole32(FUNCTIONFS_DESCRIPTORS_MAGIC_V2);
    d.head.flags = htole32(FUNCTIONFS_HAS_FS_DESC | FUNCTIONFS_HAS_HS_DESC | FUNCTIONFS_ALL_CTRL_RECIP);
    d.head.length = htole32(sizeof d);
    d.full_speed_count = d.high_speed_count = htole32(2);
    for (Descriptors::Set* s : {&d.full_speed, &d.high_speed}) {
        s->interface.bLength = sizeof s->interface;
        s->interface.bDescriptorType = USB_DT_INTERFACE;
        s->interface.bNumEndpoints = 1;
        s->interface.bInterfaceClass = USB_CLASS_VENDOR_SPEC;
        s->interface.iInterface = 1;
        s->endpoint.bLength = sizeof s->endpoint;
        s->endpoint.bDescriptorType = USB_DT_ENDPOINT;
        s->endpoint.bEndpointAddress = 1 | USB_DIR_IN;
        s->endpoint.bmAttributes = USB_ENDPOINT_XFER_BULK;
        s->endpoint.wMaxPacketSize = htole16(s == &d.high_speed ? 512 : 64);
    }
    Strings s{};
    s.head.magic = htole32(FUNCTIONFS_STRINGS_MAGIC);
    s.head.length = htole32(sizeof s);
    s.head.str_count = s.head.lang_count = htole32(1);
    s.language = htole16(0x0409);
    std::strcpy(s.text, "Maestro");
    return ::write(ep0, &d, sizeof d) == ssize_t(sizeof d) && ::write(ep0, &s, sizeof s) == ssize_t(sizeof s);
}

bool write_file(const std::string& file, const std::string& text) {
    const int fd = ::open(file.c_str(), O_WRONLY);
    const bool good = fd >= 0 && ::write(fd, text.data(), text.size()) == ssize_t(text.size());
    if (fd >= 0) ::close(fd);
    return good;
}

struct Gadget {
    MaestroModel board;
    std::mutex mutex;
    std::atomic<bool> told{false}, hang{false}, stall{false};
};

void serve(Gadget& g, int ep0, const usb_ctrlrequest& r) {
    const bool in = r.bRequestType & USB_DIR_IN;
    const int length = le16toh(r.wLength);
    if (g.hang.exchange(false)) std::this_thread::sleep_for(std::chrono::milliseconds(500));
    std::vector<std::uint8_t> reply;
    bool good = !g.stall.exchange(false);
    {
        const std::lock_guard lock(g.mutex);
        const int index = le16toh(r.wIndex);
        good = good && answer(g.board, r.bRequestType, r.bRequest, le16toh(r.wValue), index, reply);
        if (good && r.bRequest == 0x85) g.told = true;
    }
    // Moving data the wrong way stalls.
    char nothing[1];
    if (in == good)
        (void)!::write(ep0, reply.data(), good ? std::min<std::size_t>(reply.size(), std::size_t(length)) : 0);
    else
        (void)!::read(ep0, nothing, 0);
}

void follow_plan(Gadget& g, const std::string& udc_file, const std::string& udc, std::vector<std::string> plan) {
    while (!g.told) std::this_thread::sleep_for(std::chrono::milliseconds(5));
    const auto began = std::chrono::steady_clock::now();
    for (const std::string& step : plan) {
        const std::size_t colon = step.find(':');
        std::this_thread::sleep_until(began + std::chrono::milliseconds(int(1e3 * std::stod(step.substr(0, colon)))));
        const std::string event = step.substr(colon + 1);
        if (event == "hang") g.hang = true;
        if (event == "stall") g.stall = true;
        if (event == "unplug") {
            write_file(udc_file, "\n");
            const std::lock_guard lock(g.mutex);
            note(g.board, unplugged, 0);
        }
        if (event == "replug") {
            const std::lock_guard lock(g.mutex);
            note(g.board, plugged_in, 0);
            write_file(udc_file, udc);
        }
        if (event == "bite") {
            const std::lock_guard lock(g.mutex);
            bite(g.board);
        }
    }
}

}  // namespace

int main(int argc, char** argv) {
    if (argc < 5) return 2;
    Gadget g;
    set_up(g.board, 18, 200, 0, 6000);
    g.board.log = std::fopen(argv[4], "w");
    const int ep0 = ::open((std::string(argv[1]) + "/ep0").c_str(), O_RDWR);
    if (ep0 < 0 || !g.board.log || !describe(ep0) || !write_file(argv[2], argv[3]))
        return std::perror("maestro_gadget"), 1;
    std::thread(follow_plan, std::ref(g), std::string(argv[2]), std::string(argv[3]),
                std::vector<std::string>(argv + 5, argv + argc))
        .detach();
    for (usb_functionfs_event e;;) {
        const ssize_t n = ::read(ep0, &e, sizeof e);
        if (n < 0 && (errno == EINTR || errno == EAGAIN || errno == EIDRM)) continue;
        if (n != ssize_t(sizeof e)) return 0;
        if (e.type == FUNCTIONFS_SETUP) serve(g, ep0, e.u.setup);
    }
}
