#pragma once
// A folder whose files are those of one run: complete, or as they were before.

#include <filesystem>
#include <string>
#include <vector>

namespace palpate {

/// Files are written into a folder inside ("palpate-unfinished-PROCESS", `part`), which a process that is killed leaves
/// behind, and moved to their names when all are complete. `files.json` lists what was written, with size and time:
/// what a later run has no file for is removed then, unless somebody has changed it since. Other files are left alone.
class ResultsFolder {
  public:
    /// Throws as throw_unwritable (mesh_files.h).
    explicit ResultsFolder(std::filesystem::path folder);
    /// What was not finished is removed.
    ~ResultsFolder();
    ResultsFolder(const ResultsFolder&) = delete;
    ResultsFolder& operator=(const ResultsFolder&) = delete;

    const std::filesystem::path& part() const { return part_; }
    /// Moves the files to their names. Returns sentences: what was replaced, removed and left alone; none for a folder
    /// that was empty. Throws as throw_unwritable.
    std::vector<std::string> finish();
    std::size_t files() const { return files_; }  ///< moved

  private:
    std::filesystem::path folder_, part_;
    bool is_new_;
    int leftovers_ = 0;  ///< of processes that were killed
    std::size_t files_ = 0;
};

}  // namespace palpate
