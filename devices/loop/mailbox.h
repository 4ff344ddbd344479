#pragma once
// One slot between the simulation step and a device loop: newest wins, nobody waits.

#include <array>
#include <atomic>

namespace palpate {

/// Triple buffer for one writer and one reader. The writer fills its own slot and swaps it with the
/// middle one; the reader swaps the middle one out when it is fresh.
template <class T>
class Mailbox {
  public:
    void publish(const T& value) {
        slots_[writing_] = value;
        writing_ = middle_.exchange(static_cast<unsigned char>(writing_ | fresh), std::memory_order_acq_rel) & index;
    }
    /// Takes the newest value, if there is one since the last call.
    bool take(T& value) {
        if (!(middle_.load(std::memory_order_relaxed) & fresh)) return false;
        reading_ = middle_.exchange(reading_, std::memory_order_acq_rel) & index;
        value = slots_[reading_];
        return true;
    }
    /// What `take` would take, left where it is; nobody may write meanwhile.
    bool peek(T& value) const {
        const unsigned char middle = middle_.load(std::memory_order_acquire);
        if (middle & fresh) value = slots_[middle & index];
        return (middle & fresh) != 0;
    }

  private:
    static constexpr unsigned char fresh = 4, index = 3;
    std::array<T, 3> slots_{};
    unsigned char writing_ = 0, reading_ = 2;
    std::atomic<unsigned char> middle_{1};
};

}  // namespace palpate
