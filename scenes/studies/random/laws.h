#pragma once
// Laws that hold in every scene, whatever it is: no reference solution is needed to see them broken.

#include <filesystem>
#include <limits>
#include <string>
#include <vector>

#include "scenes/load/finger_mesh.h"

namespace palpate {

struct Violation {
    std::string law;    ///< its name, the same for the same law
    std::string found;  ///< when, where, by how much
};

/// Found, but no law that is broken: runs of a scene end in forces as unlike each other when its fingers begin a
/// micrometre aside, so that runs that were not to differ say nothing there.
inline constexpr char several_answers[] = "has more than one answer";

/// How much of a scene's comparisons with other runs of it is made: beginning with one of them, in turn until other
/// runs have taken so many Newton iterations (of all fingers). What a single run shows is always looked at.
struct LawBudget {
    std::size_t first = 0;
    double iterations = std::numeric_limits<double>::infinity();
};

/// Runs a scene file, several times where a law compares runs, and says which laws it broke. Throws InputError where it
/// cannot be loaded. Meshes are taken from `templates`, where there are any, and put there.
std::vector<Violation> broken_laws(const std::filesystem::path& scene, FingerTemplates* templates = nullptr,
                                   const LawBudget& budget = {});

}  // namespace palpate
