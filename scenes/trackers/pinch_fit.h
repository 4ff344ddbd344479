#pragma once
// Calibration of tracked fingers to model fingers, from the moment in which two of them touch.

#include <string>

#include "engine/skin/chunks/topology.h"
#include "scenes/trackers/hand_recording.h"

namespace palpate {

/// Two fingers that touch each other while a hand is tracked.
struct PinchFit {
    int frames = 0;                           ///< that were taken: the closest
    double gap = 0;                           ///< between the tracked tips [m]
    double start = 0, end = 0;                ///< of the pinch in the recording [s]
    Vec3<double> place{0, 0, 0};              ///< where they touch, tracker's world [m]
    std::array<Pose<double>, 2> fit{};        ///< per finger: tracked -> model, in the tracked finger's frame
    std::array<Vec3<double>, 2> direction{};  ///< per finger: towards the other, in the tracked finger's frame
};

/// Rolls each finger about its axis until its pad faces the other, and moves it until its surface touches the middle
/// between the tracked tips, or something `thickness` [m] thick there. `pads`: the model fingers' meshes. Throws
/// InputError where the two never come near each other.
PinchFit fit_pinch(const HandRecording& recording, const std::array<int, 2>& fingers,
                   const std::array<const TetMesh*, 2>& pads, double thickness);

}  // namespace palpate
