#pragma once
// Meshes that were made once are read the next time, bit for bit: making one takes a second, and every program that
// loads a finger would wait for it.

#include <cstdint>
#include <filesystem>
#include <functional>

#include "meshes/tetrahedralise.h"

namespace palpate {

/// $XDG_CACHE_HOME/palpate, or ~/.cache/palpate; empty where neither is set. It need not exist, or be writable.
std::filesystem::path cache_folder();

/// What a mesh is made of, and by which mesher, as a number: its file's name.
struct MeshKey {
    std::array<std::uint64_t, 2> hash{};
    explicit MeshKey(const char* method);
    MeshKey& add(double value);
    MeshKey& add(const Surface& surface);
};

/// What `make` gave for this key before, on this computer, from `cache_folder()`/meshes; else what it gives now, which
/// is kept there if that can be written: whole or not at all, the newest few hundred. A damaged file is made anew. What
/// `make` throws is not kept.
TetMesh made_once(const MeshKey& key, const std::function<TetMesh()>& make);

}  // namespace palpate
