#pragma once
// What moves a scene: poses, tracks, recordings of hands and live ones.

#include "scenes/load/scene.h"
#include "scenes/load/section.h"

namespace palpate {

/// position_mm and rotation_deg of a table.
Pose<double> read_pose(Section& s, const char* position_sentence);
/// track = [ ... ] of a table.
std::vector<Keyframe> read_track(Section& owner, const char* sentence);

/// [recording] replays a hand, [tracker] follows a live one. Which hand's files are read, the fingers say.
struct HandSource {
    std::filesystem::path file;
    int hand = 1;
    bool loop = false, unusable = false;
};
HandSource read_hand_source(Section& root, Scene& scene, const std::filesystem::path& folder);
/// `follow` of a finger, and what belongs to it.
void read_followed(Section& s, Scene& scene, const HandSource& source, FingerMotion& motion);

}  // namespace palpate
