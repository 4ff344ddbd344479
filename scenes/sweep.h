#pragma once
// Speed against accuracy: a scene over settings, against a converged reference of finer steps.

#include "scenes/simulation.h"

namespace palpate {

/// One setting and the values that it takes. `finger.*.` stands for all fingers.
struct SweepAxis {
    std::string key;
    std::vector<std::string> values;
};
/// From "dt_ms=1,2,5". Throws InputError.
SweepAxis parse_axis(const std::string& text);
/// Time step, iterations, precision.
std::vector<SweepAxis> default_axes();

/// What a run leaves for comparison, at times that all runs share.
struct SweepTrace {
    struct Finger {
        Vec3<double> net{0, 0, 0};
        double area = 0;                    ///< [m^2]
        std::vector<Vec3<double>> field;    ///< [sample]
        Eigen::Vector3d platform{0, 0, 0};  ///< its centre, finger frame [m]
        bool has_platform = false;
    };
    std::vector<std::vector<Finger>> samples;  ///< [time][finger]
};

/// Mean errors over times and fingers, as shares of the mean of the reference; NaN where there is nothing to compare.
struct SweepErrors {
    double field = 0, net = 0, area = 0;
    double platform_mm = 0;  ///< mean distance of the platform's centre
};

struct SweepPoint {
    std::vector<std::string> values;  ///< one per axis
    SweepErrors errors;
    double median_us = 0, p99_us = 0, seconds_per_second = 0;  ///< of a step; compute time per simulated second
    double dt_ms = 0, limit_violation = 0, penetration_um = 0, converged = 0;
    std::int64_t resets = 0;
    bool failed = false;  ///< reset, or not finite
};

/// Runs a scene with overrides; samples it every `period` seconds.
SweepPoint run_point(const std::filesystem::path& scene, const std::vector<std::string>& overrides, double period,
                     int threads, const std::atomic<bool>& stop, SweepTrace& trace);
SweepErrors errors_of(const SweepTrace& trace, const SweepTrace& reference);

/// Every combination of the axes' values, in order; as overrides for load_scene.
std::vector<std::vector<std::string>> combinations(const std::vector<SweepAxis>& axes);
std::vector<std::string> overrides_of(const std::vector<SweepAxis>& axes, const std::vector<std::string>& values,
                                      const std::vector<std::string>& finger_names);

/// Whether no other point is both faster and closer.
bool on_front(const SweepPoint& point, const std::vector<SweepPoint>& all);

}  // namespace palpate
