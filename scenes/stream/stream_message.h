#pragma once
// Lines of a stream. One object a line; numbers in SI units, poses as 7 numbers (position x y z, rotation w x y z):
//
//   {"palpate": 1,                         version of the schema
//    "time": s, "step": n,                 simulated, at the end of the step
//    "fingers": [{"name": "...", "tracked": pose, "age": s since it was seen, "pose": of the bone,
//                 "force": [3] N, "torque": [3] N m about the bone's origin, "normal_force": N,
//                 "centre": [3] m of pressure, or null, "area": m^2, "touching": samples, "converged": true,
//                 "samples": {"positions": [[3], ...], "forces": [[3], ...]},        where asked for
//                 "thimble": {"kind": "...", "configuration": [...], "wanted": [...], "sent": [...],
//                             "reached": [...] rad}}],                               where it wears one
//    "objects": [{"name": "...", "pose": pose, "velocity": [3] m/s, "spin": [3] rad/s,
//                 "force": [3] N on it (object_output.h),
//                 "samples": {"positions": [[3], ...], "forces": [[3], ...]}}]}       of a soft one, where asked for
//
// Commands, in the other direction, likewise:
//   {"pause": true}   {"finger": "index", "pose": pose or null (not seen)}   {"object": "ball", "pose": pose}
//   {"finger": "index", "release": true}   {"object": "ball", "release": true}   {"samples": true}
//   {"set": ["key=value"]}    of a view whose thimbles are not armed
// Nothing that is sent arms a thimble.

#include <string>
#include <vector>

#include "scenes/run/simulation.h"

namespace palpate {

inline constexpr int stream_version = 1;

/// Names that stay the same from step to step.
struct StreamNames {
    std::vector<std::string> fingers, objects;  ///< quoted as JSON
    std::vector<int> thimbles;                  ///< [finger] row; -1: none
    std::vector<std::string> kinds;             ///< [thimble] quoted
    std::vector<int> soft;                      ///< [object] row among soft ones; -1: rigid
};
StreamNames stream_names(const Simulation& simulation);

/// What one line says, as numbers; filled without allocation once it has been filled.
struct StreamNumbers {
    struct Samples {
        std::vector<Vec3<double>> positions, forces;
    };
    struct Finger {
        Pose<double> tracked, bone;
        double age, normal_force, area;
        Vec3<double> force, torque, centre;
        int touching;
        bool converged;
        Samples samples;
        Coordinates configuration, wanted, sent, reached;
    };
    struct Object {
        Pose<double> pose;
        Vec3<double> velocity, spin, force;
        Samples samples;
    };
    double time = 0;
    std::int64_t step = 0;
    bool samples = false;
    std::vector<Finger> fingers;
    std::vector<Object> objects;
};
void take_numbers(const Simulation& simulation, const StreamNames& names, bool samples, StreamNumbers& out);

/// Appends the line with its end. Numbers are written so that they are read as the same bits; those of samples to 7
/// digits.
void append_line(const StreamNumbers& numbers, const StreamNames& names, bool samples, std::string& out);

}  // namespace palpate
