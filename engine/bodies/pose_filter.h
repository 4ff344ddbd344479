#pragma once
// One-euro filter of a tracked pose (Casiez, Roussel & Vogel 2012): a low-pass whose cutoff rises with speed, so that a
// hand at rest does not tremble and one that moves is not held back.

#include <cmath>
#include <cstdint>

#include "engine/math/pose.h"

namespace palpate {

/// Tracker: filter of its pose; absent where poses are taken as they come.
struct PoseFilter {
    double min_cutoff = 2;       ///< at rest [Hz]
    double speed_factor = 0.05;  ///< rise of the cutoff with the speed of the finger [Hz per mm/s]
    double turn_factor = 0.05;   ///< and of its rotation [Hz per degree/s]
    double speed_cutoff = 5;     ///< of the speeds' own low-pass [Hz]
    double lead = 0;             ///< how far ahead of the samples poses are extrapolated [s]
    bool started = false;
    Pose<double> pose = Pose<double>::identity();   ///< filtered
    Pose<double> last = Pose<double>::identity();   ///< last sample
    double time = 0;                                ///< of the last sample [s]
    double speed = 0, turn = 0;                     ///< low-passed [mm/s], [degree/s]
    Vec3<double> velocity{0, 0, 0}, spin{0, 0, 0};  ///< of the filtered pose, low-passed [m/s], [rad/s]
    double delay = 0, delay_sum = 0;  ///< of the last sample, and the sum over samples [s]: 1 / (2 pi cutoff) - lead
    std::int64_t samples = 0;
};

namespace detail {
inline double low_pass_share(double cutoff, double dt) { return 1 / (1 + 1 / (6.283185307179586 * cutoff * dt)); }

/// The filtered pose, carried on by its velocity for the time of the lead.
inline Pose<double> extrapolated(const PoseFilter& f) {
    if (f.lead <= 0) return f.pose;
    return {f.pose.position + f.lead * f.velocity, normalised(rotation_step(f.lead * f.spin) * f.pose.rotation)};
}
}  // namespace detail

/// Takes a sample; returns the filtered pose. A sample of the same time changes nothing.
inline Pose<double> filter_pose(PoseFilter& f, const Pose<double>& sample, double time) {
    const double dt = time - f.time;
    if (!f.started || dt > 0.5) {  // at the start, and after a long gap
        f.started = true;
        f.pose = f.last = sample;
        f.time = time;
        f.speed = f.turn = 0;
        f.velocity = f.spin = {0, 0, 0};
        return f.pose;
    }
    if (!(dt > 0)) return detail::extrapolated(f);
    const Quaternion<double> turned = sample.rotation * conjugate(f.last.rotation);
    const double share = detail::low_pass_share(f.speed_cutoff, dt);
    f.speed += share * (1e3 * norm(sample.position - f.last.position) / dt - f.speed);
    f.turn += share * (57.29577951308232 * norm(shorter_twice_vector(turned)) / dt - f.turn);
    const double cutoff = f.min_cutoff + f.speed_factor * f.speed, turn_cutoff = f.min_cutoff + f.turn_factor * f.turn;
    const Vec3<double> moved = detail::low_pass_share(cutoff, dt) * (sample.position - f.pose.position);
    const Vec3<double> turned_by = shorter_twice_vector(sample.rotation * conjugate(f.pose.rotation));
    const Vec3<double> rolled = detail::low_pass_share(turn_cutoff, dt) * turned_by;
    f.pose = {f.pose.position + moved, normalised(rotation_step(rolled) * f.pose.rotation)};
    f.velocity += share * ((1 / dt) * moved - f.velocity);
    f.spin += share * ((1 / dt) * rolled - f.spin);
    f.last = sample;
    f.time = time;
    f.delay = 1 / (6.283185307179586 * cutoff) - f.lead;
    f.delay_sum += f.delay;
    ++f.samples;
    return detail::extrapolated(f);
}

}  // namespace palpate
