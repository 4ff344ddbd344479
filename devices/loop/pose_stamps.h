#pragma once
// When the tracked poses of the newest steps had come from their trackers.

#include <array>
#include <atomic>
#include <cstdint>

namespace palpate {

/// Arrivals of poses by when steps read them, of the newest 256 steps. One writer; any reader.
class PoseStamps {
  public:
    struct Times {
        double arrived_at = 0, done_at = 0;  ///< 0: not known [s of device_clock]
    };

    /// Poses that were read at `sampled_at` had arrived at `arrived_at` [s of device_clock].
    void add(double sampled_at, double arrived_at) {
        Stamp& s = ring_[next_++ % ring_.size()];
        s.sampled_at.store(0, std::memory_order_release);  // a reader meanwhile finds none
        s.arrived_at.store(arrived_at, std::memory_order_release);
        s.done_at.store(0, std::memory_order_release);
        s.sampled_at.store(sampled_at, std::memory_order_release);
    }
    /// The step of the newest of them is done.
    void done(double done_at) {
        if (next_ > 0) ring_[(next_ - 1) % ring_.size()].done_at.store(done_at, std::memory_order_release);
    }
    Times of(double sampled_at) const {
        if (sampled_at <= 0) return {};
        for (const Stamp& s : ring_) {
            const Times times{s.arrived_at.load(std::memory_order_acquire), s.done_at.load(std::memory_order_acquire)};
            if (s.sampled_at.load(std::memory_order_acquire) == sampled_at) return times;
        }
        return {};
    }

  private:
    struct Stamp {
        std::atomic<double> sampled_at{0}, arrived_at{0}, done_at{0};
    };
    std::array<Stamp, 256> ring_{};
    std::size_t next_ = 0;
};

}  // namespace palpate
