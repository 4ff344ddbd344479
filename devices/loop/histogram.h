#pragma once
// Durations, counted in bins by any thread, read by any other.

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstdint>

namespace palpate {

class LatencyHistogram {
  public:
    static constexpr int bins = 240;
    static constexpr double shortest = 1e-6, ratio = 1.0723;  ///< 33 bins a decade, from 1 us to 19 s

    void add(double seconds) {
        const double bin = seconds > shortest ? std::log(seconds / shortest) / std::log(ratio) : 0;
        count_[std::size_t(std::min(double(bins - 1), bin))].fetch_add(1, std::memory_order_relaxed);
        double worst = worst_.load(std::memory_order_relaxed);
        while (seconds > worst && !worst_.compare_exchange_weak(worst, seconds, std::memory_order_relaxed)) {}
    }
    std::int64_t count() const {
        std::int64_t sum = 0;
        for (const auto& c : count_) sum += c.load(std::memory_order_relaxed);
        return sum;
    }
    /// Upper end of the bin in which the quantile lies [s].
    double quantile(double share) const {
        const std::int64_t all = count();
        std::int64_t sum = 0;
        for (int b = 0; b < bins; ++b) {
            sum += count_[std::size_t(b)].load(std::memory_order_relaxed);
            if (all > 0 && double(sum) >= share * double(all))
                return std::min(worst(), shortest * std::pow(ratio, b + 1));
        }
        return 0;
    }
    /// Share of durations of at most `seconds`, to the width of a bin.
    double share_within(double seconds) const {
        std::int64_t within = 0, all = 0;
        for (int b = 0; b < bins; ++b) {
            const std::int64_t n = count_[std::size_t(b)].load(std::memory_order_relaxed);
            all += n;
            if (shortest * std::pow(ratio, b) < seconds) within += n;
        }
        return all ? double(within) / double(all) : 1;
    }
    double worst() const { return worst_.load(std::memory_order_relaxed); }

  private:
    std::array<std::atomic<std::int64_t>, bins> count_{};
    std::atomic<double> worst_{0};
};

}  // namespace palpate
