#pragma once
// Laws that hold in every scene, whatever it is: no reference solution is needed to see them broken.

#include <filesystem>
#include <string>
#include <vector>

namespace palpate {

struct Violation {
    std::string law;    ///< its name, the same for the same law
    std::string found;  ///< when, where, by how much
};

/// Runs a scene file, several times where a law compares runs, and says which laws it broke. Throws InputError where it
/// cannot be loaded.
std::vector<Violation> broken_laws(const std::filesystem::path& scene);

}  // namespace palpate
