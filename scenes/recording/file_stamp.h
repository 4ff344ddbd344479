#pragma once
// Files that a scene names: whether they are still what they were when a run was recorded, or a world made.

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace palpate {

/// FNV-1a.
std::uint64_t hash_of(const void* data, std::size_t size, std::uint64_t hash = 1469598103934665603ull);

struct FileStamp {
    std::string file;
    std::uint64_t bytes = 0, hash = 0;
};

/// Of each file once. Files that cannot be read are left out.
std::vector<FileStamp> stamps_of(const std::vector<std::filesystem::path>& files);

/// A sentence for each one that is no longer what it was; `since` says when that was.
std::vector<std::string> changes_of(const std::vector<FileStamp>& stamps, const std::string& since);

}  // namespace palpate
