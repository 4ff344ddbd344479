#pragma once
// What tests of libpalpate.so share: worlds that are destroyed, their bytes, a small scene.

#include <gtest/gtest.h>
#include <palpate/palpate.h>

#include <sys/wait.h>

#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <stdexcept>
#include <string>
#include <vector>

inline std::string scene_file(const std::string& name) { return std::string(PALPATE_SOURCE_DIR) + "/scenes/" + name; }

struct Outcome {
    int code;
    std::string out;
};
inline Outcome shell(const std::string& command) {
    Outcome o;
    FILE* pipe = popen((command + " 2>&1").c_str(), "r");
    char text[4096];
    for (std::size_t n; (n = std::fread(text, 1, sizeof text, pipe)) > 0;) o.out.append(text, n);
    const int status = pclose(pipe);
    o.code = WIFEXITED(status) ? WEXITSTATUS(status) : 128;
    return o;
}

class Folder {
  public:
    Folder() {
        std::string name = (std::filesystem::temp_directory_path() / "palpate-api-XXXXXX").string();
        if (!mkdtemp(name.data())) throw std::runtime_error("no scratch folder");
        path = name;
    }
    ~Folder() {
        std::error_code ignored;
        std::filesystem::remove_all(path, ignored);
    }
    std::filesystem::path path;
};

/// A world that is destroyed at the end of the test.
class Held {
  public:
    Held() = default;
    ~Held() { palpate_destroy(id); }
    Held(const Held&) = delete;
    Held& operator=(const Held&) = delete;
    operator PalpateWorld() const { return id; }
    PalpateWorld id = 0;
};

inline PalpateWorldDef with_settings(const std::vector<const char*>& settings) {
    PalpateWorldDef def;
    palpate_default_world_def(&def, sizeof def);
    def.settings = settings.data();
    def.setting_count = std::int32_t(settings.size());
    return def;
}

inline PalpateWorldInfo info_of(PalpateWorld world) {
    PalpateWorldInfo info{};
    info.size = sizeof info;
    EXPECT_EQ(PALPATE_OK, palpate_get_info(world, &info)) << palpate_last_error();
    return info;
}

inline std::vector<char> bytes_of(PalpateWorld world, std::int32_t field, std::int32_t index) {
    PalpateView v{};
    v.size = sizeof v;
    EXPECT_EQ(PALPATE_OK, palpate_view(world, field, index, &v)) << palpate_last_error();
    const std::size_t each = v.type == PALPATE_FLOAT64 ? 8 : v.type == PALPATE_INT32 ? 4 : 1;
    const auto* p = static_cast<const char*>(v.data);
    return {p, p + each * std::size_t(v.shape[0]) * std::size_t(v.rank == 2 ? v.shape[1] : 1)};
}

/// All that changes in a world, as bytes.
inline std::vector<std::vector<char>> all_of(PalpateWorld world) {
    const PalpateWorldInfo info = info_of(world);
    std::vector<std::vector<char>> all;
    for (std::int32_t i = 0; i < info.finger_count; ++i)
        for (int field : {PALPATE_NODES, PALPATE_FORCES, PALPATE_TOUCHES, PALPATE_POSITIONS, PALPATE_PRESSURES})
            all.push_back(bytes_of(world, field, i));
    for (std::int32_t i = 0; i < info.thimble_count; ++i)
        for (int field : {PALPATE_CONFIGURATION, PALPATE_JOINTS_WANTED, PALPATE_JOINTS_SENT, PALPATE_JOINTS_REACHED})
            all.push_back(bytes_of(world, field, i));
    for (int field : {PALPATE_BONE_POSES, PALPATE_NET_FORCES, PALPATE_NET_TORQUES, PALPATE_CENTRES,
                      PALPATE_OBJECT_POSES, PALPATE_OBJECT_MOTIONS})
        all.push_back(bytes_of(world, field, -1));
    return all;
}

inline std::vector<char> saved(PalpateWorld world) {
    std::int64_t size = 0;
    EXPECT_EQ(PALPATE_OK, palpate_save(world, nullptr, 0, &size)) << palpate_last_error();
    std::vector<char> state(static_cast<std::size_t>(size));
    EXPECT_EQ(PALPATE_OK, palpate_save(world, state.data(), size, &size)) << palpate_last_error();
    return state;
}

const char* const small_scene = R"(
duration_s = 0.2
dt_ms = 1
[solver]
preset = "balanced"
[[object]]
name = "table"
kind = "plane"
friction = 0.5
[[object]]
name = "cube"
kind = "box"
size_mm = [10, 10, 10]
position_mm = [60, 0, 5]
mass_g = 5
[[finger]]
name = "index"
elements = 120
track = [ { t_s = 0, position_mm = [0, 0, 10] }, { t_s = 0.05, position_mm = [0, 0, 6] } ]
)";
