#pragma once
// Control transfers through libusb that never wait for ever: where USB does not give one back, not even a cancelled
// one, what it points to is left behind, and so is libusb's context, which could only be ended by waiting.

#include <libusb.h>

#include <sys/time.h>

#include <chrono>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "devices/drivers/maestro_protocol.h"

namespace palpate::usb {

inline constexpr unsigned timeout_ms = 100;

/// libusb's word for what went wrong, and what to do about it.
std::string problem_of(int rc);

class Context {
  public:
    /// Throws std::runtime_error where USB cannot be used at all.
    Context();
    ~Context();
    Context(const Context&) = delete;
    Context& operator=(const Context&) = delete;
    libusb_context* get() const { return raw_; }
    /// Waits until done() or for `milliseconds`. False where it is not done.
    template <class Done>
    bool wait(Done done, int milliseconds);
    bool stuck = false;  ///< a transfer was never given back: nothing of this context is closed any more

  private:
    libusb_context* raw_ = nullptr;
};

/// An open device.
class Handle {
  public:
    Handle() = default;
    Handle(Context& context, libusb_device_handle* raw) : context_(&context), raw_(raw) {}
    ~Handle() { reset(); }
    Handle(Handle&& other) noexcept : context_(other.context_), raw_(std::exchange(other.raw_, nullptr)) {}
    Handle& operator=(Handle&& other) noexcept {
        if (this == &other) return *this;
        reset();
        context_ = other.context_;
        raw_ = std::exchange(other.raw_, nullptr);
        return *this;
    }
    void reset() {
        if (raw_ && !context_->stuck) libusb_close(raw_);
        raw_ = nullptr;
    }
    libusb_device_handle* get() const { return raw_; }
    Context& context() const { return *context_; }
    explicit operator bool() const { return raw_; }

  private:
    Context* context_ = nullptr;
    libusb_device_handle* raw_ = nullptr;
};

/// A control transfer that waits, for a sixth of a second at most. Returns what came back for reads, `r.length` bytes
/// unless `any_length`; throws std::runtime_error with problem_of() where it failed.
std::vector<std::uint8_t> transfer(const Handle& handle, const maestro::Request& r, bool any_length = false);

/// A string descriptor, as ASCII.
std::string string_of(const Handle& handle, std::uint8_t index);

template <class Done>
bool Context::wait(Done done, int milliseconds) {
    const auto end = std::chrono::steady_clock::now() + std::chrono::milliseconds(milliseconds);
    while (!done()) {
        if (std::chrono::steady_clock::now() >= end) return false;
        timeval step{0, 5000};
        libusb_handle_events_timeout_completed(raw_, &step, nullptr);
    }
    return true;
}

}  // namespace palpate::usb
