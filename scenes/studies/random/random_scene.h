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

/// Elements of its fingers' meshes: of uniform ones, and where nothing is said, which conform.
inline constexpr int random_scene_elements[] = {120, 180, 250}, random_scene_conforming_elements[] = {250, 300, 350};
/// Seeds from here on are of fingers of which nothing is said; those below stay as they were when that meant uniform.
inline constexpr unsigned first_seed_of_conforming = 100'000;
/// Seeds from here on are short: a third of the steps, in which all moves twice as far, and fewer fingers; now and then
/// with settings that few touch, and turned objects.
inline constexpr unsigned first_seed_of_short = 1'000'000;
/// From here on every twelfth has a deadline, most of which nothing can keep.
inline constexpr unsigned first_seed_of_deadlines = 1'400'000;
inline bool is_short_scene(unsigned seed) { return seed >= first_seed_of_short; }
/// And from here on of what fewer people write.
inline constexpr unsigned first_seed_of_odd = 2'000'000;
/// And from here on of what hands do with things, which takes longer: they lift, move and turn them, stack them, press
/// firmly and come back.
inline constexpr unsigned first_seed_of_handled = 3'000'000;

/// The same scene for the same seed, on every machine.
RandomScene random_scene(unsigned seed);

/// A scene with one of each finger that random scenes are made of, uniform, or as where nothing is said; `other`:
/// presets and conforming ones, too, which the seeds need that has_other_fingers says.
RandomScene random_scene_fingers(bool other, bool uniform);
inline bool has_other_fingers(unsigned seed) { return seed % 10 == 4 || seed >= first_seed_of_odd; }
/// Whether scenes from a seed on have uniform fingers, or conforming ones: short ones have either.
inline bool has_fingers(unsigned seed, bool uniform) {
    return is_short_scene(seed) || uniform == (seed < first_seed_of_conforming);
}

/// Text of a scene file.
std::string to_text(const RandomScene& scene);

}  // namespace palpate
