#pragma once
// A scene as loaded: what to build, what moves it, and how it is run.

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "devices/drivers/board.h"
#include "devices/drivers/simulated.h"
#include "devices/loop/loop.h"
#include "engine/build.h"
#include "scenes/load/finger_model.h"
#include "scenes/trackers/hand_recording.h"
#include "scenes/trackers/trajectory.h"

namespace palpate {

/// What moves a finger: a script relative to the hand's script, or a recorded hand.
struct FingerMotion {
    std::vector<Keyframe> keyframes;
    int followed_finger = -1;                     ///< index into finger_names; -1: scripted
    int hand = 1;                                 ///< of the followed finger: index into hand_names
    Pose<double> fit = Pose<double>::identity();  ///< tracked finger -> model finger, in the tracked finger's frame
};

/// What drives a thimble once armed.
struct DriverSpec {
    std::string driver = "simulated";
    std::string serial, port;              ///< of the controller: USB serial number, or tty
    std::vector<int> channels;             ///< per joint
    std::vector<ServoCalibration> servos;  ///< per joint
    bool calibrated = false;               ///< servos come from a calibration file
    bool operator==(const DriverSpec&) const = default;
};

struct Scene {
    std::filesystem::path file;
    std::optional<std::string> text;           ///< of a scene that was given as text: there is no such file
    std::vector<std::filesystem::path> files;  ///< that it names, and was made of: meshes, fingers, recordings
    std::string title;
    double duration = 1;  ///< [s]
    SceneSpec spec;
    int preset = 3;                                     ///< of preset_names()
    double deadline = 0;                                ///< of a step, for the governor of presets [s]; 0: none
    std::vector<Keyframe> hand;                         ///< empty: the hand stays at the origin
    std::vector<FingerMotion> finger_motions;           ///< per finger
    std::vector<std::vector<Keyframe>> object_motions;  ///< per object; empty: fixed
    std::array<std::shared_ptr<const HandRecording>, 2> recordings;  ///< per hand; absent unless a finger follows it
    Pose<double> tracker_pose = Pose<double>::identity();            ///< tracker's or recording's frame -> world
    double recording_start = 0;                                      ///< time in the recording at scene time 0 [s]
    double recording_speed = 1;                                      ///< recorded seconds per second
    std::string tracker;                                             ///< source of live hands (hand_source.h)
    double tracker_timeout = 2;  ///< of silence, after which a thimble is led to rest [s]
    double scale_pressure = 0;   ///< where colour scales end [Pa]; 0: as the run has it
    double scale_force = 0;      ///< whose arrow is longest [N]; 0: as the run has it
    ThimbleLoopSettings loop;
    ServoModel servo;                        ///< of simulated thimbles
    std::vector<DriverSpec> drivers;         ///< per thimble
    std::vector<FingerModel> finger_models;  ///< per finger, as the files describe it
    std::vector<std::string> mesh_notes;     ///< per finger: what was built, what was guessed
    std::vector<std::string> warnings;       ///< what was accepted, but is likely a mistake
    std::vector<std::string> notes;          ///< what may be said in a newer way
};

/// Reads a scene file and builds its meshes. `overrides` are "key=value". Throws InputError with all
/// problems at once, each with file, line, column, key, expectation and finding. Meshes of finger shapes are taken from
/// `templates`, where there are any, and put there: several scenes may share them.
Scene load_scene(const std::filesystem::path& file, const std::vector<std::string>& overrides = {},
                 FingerTemplates* templates = nullptr);

/// The same from text: messages call it `file`, files that it names are looked for in that one's folder; it need not
/// exist.
Scene load_scene_text(const std::string& text, const std::filesystem::path& file,
                      const std::vector<std::string>& overrides = {}, FingerTemplates* templates = nullptr);

/// Says warnings and notes about a scene on standard error, one a line.
void print_warnings(const Scene& scene);

/// All that may stand in a scene file.
KeyInfo scene_keys();

/// A followed finger's sample, as the tracker gives it, in the world: the tracker's place and the finger's fit applied.
TrackerPose::Sample placed(const Scene& scene, int finger, TrackerPose::Sample sample);

/// Pose of a finger at a time, scripted or recorded; not valid where it follows a live hand.
TrackerPose::Sample tracked_pose(const Scene& scene, int finger, double time);

}  // namespace palpate
