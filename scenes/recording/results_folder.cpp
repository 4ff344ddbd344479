#include "scenes/recording/results_folder.h"

#include <signal.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "meshes/mesh_files.h"
#include "scenes/web/bounded_json.h"

namespace palpate {

namespace fs = std::filesystem;

namespace {

constexpr const char* manifest = "files.json";
const std::string part_prefix = "palpate-unfinished-";

/// What tells whether a file is still the one that was written.
struct Stamp {
    std::uintmax_t bytes;
    std::int64_t modified;
    friend bool operator==(const Stamp&, const Stamp&) = default;
};
using Written = std::multimap<std::string, Stamp>;  ///< by name from the folder

Stamp stamp_of(const fs::path& path) {
    std::error_code error;
    return {fs::file_size(path, error), fs::last_write_time(path, error).time_since_epoch().count()};
}

Written read_manifest(const fs::path& folder) {
    Written out;
    std::error_code error;
    if (!fs::is_regular_file(folder / manifest, error)) return out;
    std::string wrong;
    const auto j = parse_object(read_file(folder / manifest), wrong, file_bounds);
    if (!wrong.empty() || !j.contains("files") || !j["files"].is_array()) return out;
    for (const auto& f : j["files"]) {
        if (!f.is_object() || !f.contains("name") || !f["name"].is_string()) continue;
        const fs::path name = fs::path(f["name"].get<std::string>()).lexically_normal();
        if (name.is_absolute() || name.empty() || *name.begin() == "..") continue;  // not of this folder
        const auto bytes = f.find("bytes"), modified = f.find("modified");
        if (bytes == f.end() || !bytes->is_number_integer() || modified == f.end() || !modified->is_number_integer())
            continue;
        out.insert({name.string(), {bytes->get<std::uintmax_t>(), modified->get<std::int64_t>()}});
    }
    return out;
}

void write_manifest(const fs::path& path, const Written& written) {
    nlohmann::json files = nlohmann::json::array();
    for (const auto& [name, stamp] : written)
        files.push_back({{"name", name}, {"bytes", stamp.bytes}, {"modified", stamp.modified}});
    write_file(path, nlohmann::json{{"written_by", "palpate"}, {"files", files}}.dump(1) + "\n");
}

Written files_in(const fs::path& folder) {
    Written out;
    for (const auto& entry : fs::recursive_directory_iterator(folder))
        if (entry.is_regular_file())
            out.insert({entry.path().lexically_relative(folder).string(), stamp_of(entry.path())});
    return out;
}

void move_file(const fs::path& from, const fs::path& to) {
    std::error_code error;
    fs::create_directories(to.parent_path(), error);
    if (!error) fs::rename(from, to, error);
    if (error) throw_unwritable(to, error.value());
}

/// Removes what processes that are gone have left unfinished; how many did.
int remove_leftovers(const fs::path& folder) {
    std::error_code error;
    int removed = 0;
    for (const auto& entry : fs::directory_iterator(folder, error)) {
        const std::string name = entry.path().filename().string();
        if (!name.starts_with(part_prefix) ||
            name.find_first_not_of("0123456789", part_prefix.size()) != std::string::npos)
            continue;
        const int process = std::atoi(name.c_str() + part_prefix.size());
        if (process > 0 && (process == ::getpid() || (::kill(process, 0) != 0 && errno == ESRCH)))
            removed += fs::remove_all(entry.path(), error) > 0;
    }
    return removed;
}

std::string count_of(std::size_t n) { return std::to_string(n) + (n == 1 ? " file" : " files"); }

/// At most three names.
std::string some_of(const std::set<std::string>& names) {
    std::string out;
    std::size_t k = 0;
    for (const std::string& name : names) {
        if (k == 3) return out + ", ...";
        out += (k++ ? ", " : "") + name;
    }
    return out;
}

}  // namespace

ResultsFolder::ResultsFolder(fs::path folder)
    : folder_(std::move(folder)), part_(folder_ / (part_prefix + std::to_string(::getpid()))) {
    std::error_code error;
    is_new_ = !fs::exists(folder_, error);
    fs::create_directories(folder_, error);
    if (!error) leftovers_ = remove_leftovers(folder_);
    if (!error) fs::create_directory(part_, error);
    if (error) throw_unwritable(folder_, error.value());
}

ResultsFolder::~ResultsFolder() {
    std::error_code ignored;
    fs::remove_all(part_, ignored);
    if (is_new_) fs::remove(folder_, ignored);  // fails, as it should, where there is something in it
}

std::vector<std::string> ResultsFolder::finish() {
    const Written now = files_in(part_), before = read_manifest(folder_);
    // Both lists stand until all is moved, so that a kill in between leaves nothing that nobody knows.
    Written both = before;
    both.insert(now.begin(), now.end());
    write_manifest(part_ / ".both", both);
    write_manifest(part_ / ".now", now);
    move_file(part_ / ".both", folder_ / manifest);
    std::set<std::string> replaced, removed, changed, foreign, others;
    std::error_code error;
    for (const auto& [name, stamp] : before) {
        const fs::path path = folder_ / name;
        if (!fs::is_regular_file(path, error)) continue;
        const bool same = stamp_of(path) == stamp;
        if (now.contains(name))
            replaced.insert(name);
        else if (same && fs::remove(path, error))
            removed.insert(name);
        else
            changed.insert(name);
    }
    for (const auto& [name, stamp] : now)
        if (fs::exists(folder_ / name, error) && !replaced.contains(name)) foreign.insert(name);
    for (const auto& [name, stamp] : now)  // a summary says that all is there
        if (!name.starts_with("summary.")) move_file(part_ / name, folder_ / name);
    for (const auto& [name, stamp] : now)
        if (name.starts_with("summary.")) move_file(part_ / name, folder_ / name);
    move_file(part_ / ".now", folder_ / manifest);
    files_ = now.size();
    is_new_ = false;
    for (const auto& entry : fs::directory_iterator(folder_, error))
        if (const std::string name = entry.path().filename().string();
            entry.is_regular_file() && name != manifest && !now.contains(name) && !changed.contains(name))
            others.insert(name);
    std::vector<std::string> said;
    if (leftovers_ > 0) said.push_back("removes what a run that was killed had left unfinished");
    if (!replaced.empty() || !removed.empty())
        said.push_back("replaces the results that were there" +
                       (removed.empty() ? std::string()
                                        : ": removed " + count_of(removed.size()) + " that this run has not (" +
                                              some_of(removed) + ")"));
    if (!foreign.empty())
        said.push_back("overwrites " + count_of(foreign.size()) + " of unknown origin (" + some_of(foreign) + ")");
    if (!changed.empty()) said.push_back("left alone, of an earlier run but changed since: " + some_of(changed));
    if (!others.empty())
        said.push_back(count_of(others.size()) + " beside them " + (others.size() == 1 ? "was" : "were") +
                       " left alone (" + some_of(others) + ")");
    return said;
}

}  // namespace palpate
