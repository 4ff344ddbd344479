#pragma once
// Hands from an OpenXR runtime (XR_EXT_hand_tracking), without a picture (XR_MND_headless).

#include "scenes/trackers/hand_source.h"

namespace palpate {

/// Asks the system's runtime for both hands 250 times a second, on a thread of its own, in its LOCAL space (y up; where
/// the headset was). A runtime that ends is looked for again every second. Throws InputError where there is none, where
/// it cannot do this, or where palpate was built without OpenXR.
std::unique_ptr<HandSourceThread> receive_openxr_hands(HandMailbox& mailbox);

}  // namespace palpate
