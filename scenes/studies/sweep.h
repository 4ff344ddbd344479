#pragma once
// Speed against accuracy: a scene over settings, against a converged reference of finer steps.

#include "scenes/run/pressure_points.h"
#include "scenes/run/simulation.h"
#include "scenes/studies/sweep_plan.h"

namespace palpate {

/// What a run leaves for comparison, at times that all runs share.
struct SweepTrace {
    struct Finger {
        Vec3<double> net{0, 0, 0};
        double area = 0;                    ///< [m^2]
        PressedPad pad;                     ///< finger frame
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
/// How force fields are compared: sample by sample (NaN where samples are others), or as seen on a grid of 3 mm. There
/// a node's force is a pressure on what is in contact of the faces around it, which falls linearly to their other
/// nodes, and each bit of it is spread over the eight corners around it.
enum class FieldComparison { samples, grid };
SweepErrors errors_of(const SweepTrace& trace, const SweepTrace& reference,
                      FieldComparison comparison = FieldComparison::samples);

/// What is left of a sequence of refinements after its last one, from its last two changes (Richardson, with the order
/// that these show, between those of a method of first order and a third of it).
double richardson(double change_before, double last_change);

/// The converged reference: half the finest step of all that is held against it and, for meshes, twice the
/// finest mesh, at least 4,000 elements.
struct ReferenceRun {
    SweepTrace trace;
    SweepErrors uncertainty;  ///< of its step, and of its mesh, by three refinements of each
    FieldComparison comparison = FieldComparison::samples;
};
struct ReferenceRequest {
    std::filesystem::path scene;
    std::vector<std::string> overrides;
    double dt_ms = 1, period = 0.02;
    int threads = 0;
    std::function<void(const std::string&)> progress;  ///< told what is solved
};
ReferenceRun solve_reference(const ReferenceRequest& request, const SweepPlan& plan, SweepReference kind,
                             const std::atomic<bool>& stop);

/// What a reader must know where a reference is not sure to 2 % of the net force and 5 % of the field: errors against
/// it are then partly its own. Empty where it is.
std::string doubt(const ReferenceRun& reference);

/// Whether no other point is both faster and closer.
bool on_front(const SweepPoint& point, const std::vector<SweepPoint>& all);

}  // namespace palpate
