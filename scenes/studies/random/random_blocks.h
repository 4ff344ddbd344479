#pragma once
// Tables that random scenes are made of: fingers, things, poses.

#include <string>
#include <vector>

#include "scenes/studies/random/random_scene.h"
#include "scenes/studies/random/random_text.h"

namespace palpate {

using Block = std::vector<std::string>;

/// A solid, standing with its lowest point at z = 0, and how far it reaches [mm].
struct Solid {
    Block keys;
    double width = 0, height = 0;
};

Solid random_solid(Random& r, double smallest, double largest);

Block object(const char* name, const Block& keys, double x, double y, double z);

/// A parametric finger, of some material, with a thimble or without.
Block finger(Random& r, const std::string& name, int elements);

/// Fingers from files and presets, conforming, with patches, of several layers.
Block any_finger(Random& r, const std::string& name);

/// A pose of a track: time [s], position [mm], roll and pitch [degrees].
std::string keyframe(double t, double x, double y, double z, double roll, double pitch);

double random_friction(Random& r);

/// Friction, and mass or now and then a surface that gives way.
void add_matter(Random& r, Block& b, bool body, double friction);

}  // namespace palpate
