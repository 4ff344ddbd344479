#pragma once
// Bodies, fingers of a block of tissue, and a world to step them in.

#include <cmath>

#include "engine/step.h"
#include "tests/support.h"

namespace palpate::testing {

inline constexpr double g = 9.81;
inline const Quaternion<double> upright = Quaternion<double>::identity();
inline Quaternion<double> about_x(double angle) { return {std::cos(angle / 2), std::sin(angle / 2), 0, 0}; }

inline ObjectSpec body(const Shape& shape, double mass, const Vec3<double>& position, double friction = 0.5) {
    ObjectSpec o{"body", shape, {position, upright}, friction};
    o.body = solid_body(shape, mass);
    return o;
}
inline const Shape cube{ShapeKind::box, {0.01, 0.01, 0.01}};
inline const Shape ball{ShapeKind::sphere, {0.01, 0, 0}};

/// A block of tissue as finger, its pad facing along `turn` (-z) at `bone`.
inline FingerSpec finger(const Pose<double>& bone) {
    FingerSpec f;
    f.name = "finger";
    f.mesh = block_mesh(3, 2, 2, 0.004);
    f.has_limits = true;
    f.start = bone;
    return f;
}

struct Lab {
    World world;
    Threads threads{2};
    explicit Lab(const SceneSpec& spec) : world(build_world(spec)) {}
    /// Steps for a time; `place` aims the fingers.
    void run(double seconds, const std::function<void(double, World&)>& place = {}) {
        for (const double end = world.time + seconds; world.time < end - 1e-9;) {
            for (std::size_t i = 0; i < world.skins.size(); ++i) {
                TrackerPose::Sample& s = world.tracker_poses.find(world.couplings[i].tracker)->incoming;
                if (!s.valid) s.pose = world.skins[i].start;
                s.valid = true, s.time = world.time;
            }
            if (place) place(world.time, world);
            step(world, threads);
        }
    }
    Pose<double>& target(int i) { return world.tracker_poses.find(world.couplings[i].tracker)->incoming.pose; }
};

}  // namespace palpate::testing
