#pragma once
// Scenes as people write them, drawn at random: fingers that press, pinch, poke and catch what there is.

#include <string>
#include <vector>

namespace palpate {

/// A scene as blocks of lines: the first stands above all tables, each other begins with its table's header. Lines and
/// blocks can be left out one by one (shrink_scene).
struct RandomScene {
    std::vector<std::vector<std::string>> blocks;
    std::string mesh;  ///< text of an OBJ file that stands beside it, `random_mesh_file`; empty: none
};
inline constexpr const char* random_mesh_file = "random-thing.obj";

/// Elements of its fingers' meshes.
inline constexpr int random_scene_elements[] = {120, 180, 250};

/// The same scene for the same seed, on every machine.
RandomScene random_scene(unsigned seed);

/// A scene with one of each finger that random scenes are made of; `other`: presets and conforming ones, too, which the
/// seeds need that has_other_fingers says.
RandomScene random_scene_fingers(bool other);
inline bool has_other_fingers(unsigned seed) { return seed % 10 == 4; }

/// Text of a scene file.
std::string to_text(const RandomScene& scene);

}  // namespace palpate
