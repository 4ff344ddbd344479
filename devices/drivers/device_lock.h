#pragma once
// One controller, one program.

#include <string>

namespace palpate {

/// Takes the exclusive lock of an open device, which its last close gives back, whatever ends the program. Throws
/// std::runtime_error where another program, or this one, drives it already. `name`: for the message.
void lock_device(int fd, const std::string& name);

/// An open device that is locked.
class DeviceLock {
  public:
    DeviceLock() = default;
    ~DeviceLock() { release(); }
    DeviceLock(const DeviceLock&) = delete;
    DeviceLock& operator=(const DeviceLock&) = delete;
    /// Throws as lock_device, and where it cannot be opened.
    void take(const std::string& path, const std::string& name);
    void release();
    int fd() const { return fd_; }

  private:
    int fd_ = -1;
};

/// Node of the USB device that a tty belongs to, for example /dev/bus/usb/001/004; empty where it belongs to none.
std::string usb_node_of_tty(const std::string& port);

}  // namespace palpate
