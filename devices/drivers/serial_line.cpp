#include "devices/drivers/serial_line.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <termios.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <stdexcept>

namespace palpate {

void SerialLine::claim(const std::string& port) {
    struct stat what {};  // what opens otherwise, as a pipe does, is left alone
    if (::stat(port.c_str(), &what) == 0 && !S_ISCHR(what.st_mode))
        throw std::runtime_error(port + " is not a serial port");
    fd_ = ::open(port.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
    if (fd_ < 0 && errno == EBUSY) throw std::runtime_error(port + " is in use: another program has it for itself");
    if (fd_ < 0) throw std::runtime_error(port + " cannot be opened: " + std::strerror(errno));
    if (::isatty(fd_) != 1) throw std::runtime_error(port + " is not a serial port");
    lock_device(fd_, port);
    if (const std::string usb = usb_node_of_tty(port); !usb.empty()) usb_.take(usb, port);
}

void SerialLine::open(const std::string& port, int baud) {
    claim(port);
    exclusive_ = ioctl(fd_, TIOCEXCL) == 0;  // against programs that know nothing of locks
    termios t{};
    if (tcgetattr(fd_, &t) != 0) throw std::runtime_error(port + " is not a serial port");
    cfmakeraw(&t);
    t.c_cflag |= CLOCAL | CREAD;
    const speed_t speed = baud == 1000000 ? B1000000 : baud == 115200 ? B115200 : B57600;
    cfsetispeed(&t, speed);
    cfsetospeed(&t, speed);
    if (tcsetattr(fd_, TCSANOW, &t) != 0) throw std::runtime_error(port + ": its speed cannot be set");
    tcflush(fd_, TCIOFLUSH);
}

void SerialLine::close() {
    usb_.release();
    if (fd_ < 0) return;
    if (exclusive_) ioctl(fd_, TIOCNXCL);  // not where another program has it
    exclusive_ = false;
    ::close(fd_);
    fd_ = -1;
}

LinkProblem SerialLine::write(std::span<const std::uint8_t> bytes) {
    if (fd_ < 0) return {"the serial port is not open", true, FaultKind::unplugged};
    const auto end = Clock::now() + std::chrono::milliseconds(100);
    for (std::size_t at = 0; at < bytes.size();) {
        const auto n = ::write(fd_, bytes.data() + at, bytes.size() - at);
        if (n > 0) {
            at += std::size_t(n);
        } else if (n < 0 && errno != EAGAIN && errno != EINTR) {
            return {std::string("the serial port is gone: ") + std::strerror(errno), true, FaultKind::unplugged};
        } else if (!wait(POLLOUT, end)) {
            return {"the serial port takes no more bytes", false, FaultKind::silent};
        }
    }
    return {};
}

std::vector<std::uint8_t> SerialLine::read(Clock::time_point end) {
    std::uint8_t bytes[256];
    if (!wait(POLLIN, end)) return {};
    const auto n = ::read(fd_, bytes, sizeof bytes);
    return n > 0 ? std::vector<std::uint8_t>(bytes, bytes + n) : std::vector<std::uint8_t>{};
}

void SerialLine::discard() {
    for (const auto end = Clock::now() + std::chrono::milliseconds(20); Clock::now() < end;)
        if (std::uint8_t bytes[256]; ::read(fd_, bytes, sizeof bytes) <= 0) return;
}

bool SerialLine::wait(short what, Clock::time_point end) const {
    const auto left = std::chrono::duration_cast<std::chrono::microseconds>(end - Clock::now()).count();
    pollfd p{fd_, what, 0};
    return left > 0 && ::poll(&p, 1, int((left + 999) / 1000)) > 0 && (p.revents & what);
}

}  // namespace palpate
