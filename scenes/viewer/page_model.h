#pragma once
// What the viewer's page draws: a model that stays, described as JSON, and frames that change, as bytes.

#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <vector>

#include "scenes/picture/scales.h"
#include "scenes/run/simulation.h"
#include "scenes/viewer/drawn_hands.h"
#include "scenes/viewer/rendered_pads.h"

namespace palpate {

/// Everything that does not change during a run: fingers with their skin's triangles and rest shape (bone frame),
/// objects, thimbles with joint limits, hands (drawn_hands.h). Lengths in metres.
nlohmann::json page_model(const Simulation& simulation);

/// Lets the page's scales end where those of pictures do.
void set_scales(nlohmann::json& model, const PictureScales& scales);

/// What has happened since the last frame.
struct SinceFrame {
    double longest_us = 0;  ///< step [us]
    int steps = 0;
    std::vector<int> converged;  ///< [finger] steps whose solve converged
};
/// Call after every step.
void note_step(SinceFrame& since, const Simulation& simulation);

/// Appends the state now, little-endian, in the model's order: time f32; since the last frame its longest step f32
/// [us], number of steps f32, and per finger those that converged f32; per finger: bone pose 7 f32, contact force and
/// area f32, units of pressure [Pa] and force [N] f32, then per skin node x, y, z i16 [2 um, bone frame], pressure u16
/// [its unit], largest departure of a principal stretch from 1 u8
/// [%], 1 where an element is at a strain limit u8; per sample contact force 3 i16 [its unit]; number of points of
/// where contact ends u16, and those, in pairs, i16 [2 um, bone frame]; per object: pose 7 f32,
/// of one of tissue the unit of pressure f32 and per skin node x, y, z f32 (the pose's frame) and pressure u16; per
/// thimble: platform pose 7 f32 (finger frame), joint angles f32, matching residual f32 [m], contact u32, points of its
/// links i16 [10 um, finger frame]; of the pad on its platform: force f32 [N], unit of pressure f32, per skin node x,
/// y, z i16 [2 um, bone frame] and pressure u16, per sample u8: 1 where it touches the object, plus 2 where it touches
/// the platform; then what DrawnHands appends.
void append_frame(std::vector<std::uint8_t>& out, const Simulation& simulation,
                  const std::vector<RenderedPad>& rendered_pads, DrawnHands& hands, const SinceFrame& since);

}  // namespace palpate
