#include "devices/drivers/device_lock.h"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <stdexcept>

namespace palpate {

void lock_device(int fd, const std::string& name) {
    if (::flock(fd, LOCK_EX | LOCK_NB) == 0) return;
    if (errno == EWOULDBLOCK)
        throw std::runtime_error(name + " is in use: it is driven already, by another program or under another name");
    throw std::runtime_error(name + " cannot be locked: " + std::strerror(errno));
}

void DeviceLock::take(const std::string& path, const std::string& name) {
    release();
    fd_ = ::open(path.c_str(), O_RDWR | O_CLOEXEC | O_NONBLOCK);
    if (fd_ < 0) throw std::runtime_error(name + ": " + path + " cannot be opened: " + std::strerror(errno));
    try {
        lock_device(fd_, name);
    } catch (...) {
        release();
        throw;
    }
}

void DeviceLock::release() {
    if (fd_ >= 0) ::close(fd_);
    fd_ = -1;
}

std::string usb_node_of_tty(const std::string& port) {
    namespace fs = std::filesystem;
    std::error_code none;
    const fs::path tty = fs::canonical(port, none);
    if (none) return "";
    // The tty belongs to an interface of the device; that is one folder up.
    const fs::path device = fs::canonical("/sys/class/tty" / tty.filename() / "device", none).parent_path();
    if (none) return "";
    int bus = 0, address = 0;
    std::ifstream(device / "busnum") >> bus;
    std::ifstream(device / "devnum") >> address;
    char node[40];
    std::snprintf(node, sizeof node, "/dev/bus/usb/%03d/%03d", bus, address);
    return bus > 0 && address > 0 ? node : "";
}

}  // namespace palpate
