#include "meshes/mesh_cache.h"

#include <unistd.h>

#include <algorithm>
#include <bit>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <optional>
#include <string>
#include <type_traits>

#include "meshes/split_mix.h"

namespace palpate {

namespace {

constexpr std::size_t most_kept = 400;  // files; some 15 kB each at 350 elements
constexpr std::uint64_t most_items = 50'000'000;

void add_to(std::array<std::uint64_t, 2>& hash, std::uint64_t value) {
    hash[0] = split_mix(hash[0] + 0x9e3779b97f4a7c15u + value);
    hash[1] = split_mix(hash[1] * 0xd1342543de82ef95u + split_mix(value));
}

void add_to(std::array<std::uint64_t, 2>& hash, const std::string& bytes) {
    for (std::size_t at = 0; at < bytes.size(); at += 8) {
        std::uint64_t word = 0;
        std::memcpy(&word, bytes.data() + at, std::min<std::size_t>(8, bytes.size() - at));
        add_to(hash, word);
    }
    add_to(hash, bytes.size());
}

// --- as bytes: each list's length, and what it holds -----------------------------------------------------------------

template <class Item>
void write(std::string& out, const std::vector<Item>& list) {
    static_assert(std::is_trivially_copyable_v<Item>);
    const std::uint64_t count = list.size();
    out.append(reinterpret_cast<const char*>(&count), sizeof count);
    out.append(reinterpret_cast<const char*>(list.data()), sizeof(Item) * list.size());
}

template <class Item>
bool read(const std::string& in, std::size_t& at, std::vector<Item>& list) {
    std::uint64_t count = 0;
    if (in.size() - at < sizeof count) return false;
    std::memcpy(&count, in.data() + at, sizeof count);
    at += sizeof count;
    if (count > most_items || in.size() - at < count * sizeof(Item)) return false;
    list.resize(count);
    std::memcpy(list.data(), in.data() + at, count * sizeof(Item));
    at += count * sizeof(Item);
    return true;
}

/// Applies f to each list of a mesh, until one is refused.
template <class Mesh, class F>
bool each_list(Mesh& m, const F& f) {
    return f(m.nodes) && f(m.tets) && f(m.surface) && f(m.bone_nodes) && f(m.pad_nodes) && f(m.patches);
}

std::array<std::uint64_t, 2> checksum_of(const MeshKey& key, const std::string& bytes) {
    std::array<std::uint64_t, 2> sum = key.hash;
    add_to(sum, bytes);
    return sum;
}

std::optional<TetMesh> kept(const std::filesystem::path& file, const MeshKey& key) {
    std::ifstream in(file, std::ios::binary);
    std::array<std::uint64_t, 2> said{};
    if (!in.read(reinterpret_cast<char*>(said.data()), sizeof said)) return {};
    const std::string bytes(std::istreambuf_iterator<char>(in), {});
    TetMesh mesh;
    std::size_t at = 0;
    if (checksum_of(key, bytes) != said) return {};
    if (!each_list(mesh, [&](auto& list) { return read(bytes, at, list); }) || at != bytes.size()) return {};
    return mesh;
}

void forget_the_oldest(const std::filesystem::path& folder) {
    std::error_code error;
    std::vector<std::pair<std::filesystem::file_time_type, std::filesystem::path>> files;
    for (const auto& entry : std::filesystem::directory_iterator(folder, error))
        files.emplace_back(entry.last_write_time(error), entry.path());
    if (files.size() <= most_kept) return;
    std::sort(files.begin(), files.end());
    for (std::size_t i = 0; i < files.size() - most_kept; ++i) std::filesystem::remove(files[i].second, error);
}

void keep(const std::filesystem::path& file, const MeshKey& key, const TetMesh& mesh) {
    std::error_code error;
    std::filesystem::create_directories(file.parent_path(), error);
    std::string bytes;
    each_list(mesh, [&](const auto& list) { return write(bytes, list), true; });
    const auto sum = checksum_of(key, bytes);
    // Under a name of its own first: others read whole files.
    const std::filesystem::path draft = file.string() + "." + std::to_string(getpid()) + "." +
                                        std::to_string(std::hash<const void*>{}(&bytes)) + ".draft";
    {
        std::ofstream out(draft, std::ios::binary);
        out.write(reinterpret_cast<const char*>(sum.data()), sizeof sum);
        out.write(bytes.data(), std::streamsize(bytes.size()));
        if (!out.flush()) return void(std::filesystem::remove(draft, error));
    }
    std::filesystem::rename(draft, file, error);
    if (error) std::filesystem::remove(draft, error);
    forget_the_oldest(file.parent_path());
}

}  // namespace

std::filesystem::path cache_folder() {
    if (const char* xdg = std::getenv("XDG_CACHE_HOME"); xdg && *xdg) return std::filesystem::path(xdg) / "palpate";
    if (const char* home = std::getenv("HOME"); home && *home)
        return std::filesystem::path(home) / ".cache" / "palpate";
    return {};
}

MeshKey::MeshKey(const char* method) {
    // What else decides over a mesh's bits: the mesher's sources (their hash is CMake's), and who compiled them.
    add_to(hash, std::string(PALPATE_MESHER " " __VERSION__ " ") + method);
}

MeshKey& MeshKey::add(double value) { return add_to(hash, std::bit_cast<std::uint64_t>(value)), *this; }

MeshKey& MeshKey::add(const Surface& surface) {
    for (const Point& p : surface.vertices)
        for (const double x : p) add(x);
    for (const auto& t : surface.triangles)
        for (const int i : t) add(double(i));
    return add(double(surface.vertices.size()));
}

TetMesh made_once(const MeshKey& key, const std::function<TetMesh()>& make) {
    const std::filesystem::path folder = cache_folder();
    if (folder.empty()) return make();
    std::string name(32, '0');
    for (std::size_t i = 0; i < 32; ++i) name[i] = "0123456789abcdef"[key.hash[i / 16] >> (4 * (i % 16)) & 15];
    const std::filesystem::path file = folder / "meshes" / name;
    if (auto mesh = kept(file, key)) return *mesh;
    TetMesh mesh = make();
    keep(file, key, mesh);
    return mesh;
}

}  // namespace palpate
