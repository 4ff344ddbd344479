#pragma once
// Files that commands write by name: nothing of another kind is lost to them.

#include <string>

namespace palpate {

enum class Output { recording, report, film, hdf5, scene, frames };

/// Refuses to write over a file that is of another kind than what would be written, which tells by how it begins (a
/// scene by its name). Empty names and files, and what is no regular file (/dev/null, a pipe), are let through. Throws
/// InputError, which names the option, the file, and what to do.
void refuse_to_replace(const std::string& option, const std::string& file, Output kind);

}  // namespace palpate
