#include "scenes/recording/file_stamp.h"

#include <algorithm>

#include "meshes/input_error.h"
#include "meshes/mesh_files.h"

namespace palpate {

std::uint64_t hash_of(const void* data, std::size_t size, std::uint64_t hash) {
    const auto* bytes = static_cast<const std::uint8_t*>(data);
    for (std::size_t i = 0; i < size; ++i) hash = (hash ^ bytes[i]) * 1099511628211ull;
    return hash;
}

std::vector<FileStamp> stamps_of(const std::vector<std::filesystem::path>& files) {
    std::vector<FileStamp> stamps;
    for (const std::filesystem::path& file : files) {
        const std::string name = std::filesystem::absolute(file).lexically_normal().string();
        const bool known = std::any_of(stamps.begin(), stamps.end(), [&](auto& s) { return s.file == name; });
        if (known) continue;
        try {
            const std::string text = read_file(name);
            stamps.push_back({name, text.size(), hash_of(text.data(), text.size())});
        } catch (const InputError&) {}  // gone since it was loaded
    }
    return stamps;
}

std::vector<std::string> changes_of(const std::vector<FileStamp>& stamps, const std::string& since) {
    std::vector<std::string> changes;
    for (const FileStamp& then : stamps) {
        const auto now = stamps_of({then.file});
        if (now.empty())
            changes.push_back(then.file + ": is gone, and was there when " + since);
        else if (now[0].bytes != then.bytes || now[0].hash != then.hash)
            changes.push_back(then.file + ": has changed since " + since + ", with " + std::to_string(then.bytes) +
                              " bytes; it has " + std::to_string(now[0].bytes) + " now");
    }
    return changes;
}

}  // namespace palpate
