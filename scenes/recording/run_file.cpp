#include "scenes/recording/run_file.h"

#include <array>
#include <cstring>

#include "meshes/input_error.h"
#include "meshes/mesh_files.h"

namespace palpate {

namespace {

constexpr char magic[8] = {'p', 'a', 'l', 'p', 'a', 't', 'e', '1'};
constexpr std::uint32_t header_kind = 1, step_kind = 2, largest_frame = 1u << 28;

std::uint32_t crc32(const std::uint8_t* bytes, std::size_t size) {
    static const auto table = [] {
        std::array<std::uint32_t, 256> t{};
        for (std::uint32_t i = 0; i < 256; ++i) {
            t[i] = i;
            for (int k = 0; k < 8; ++k) t[i] = t[i] & 1 ? 0xEDB88320u ^ (t[i] >> 1) : t[i] >> 1;
        }
        return t;
    }();
    std::uint32_t crc = ~0u;
    for (std::size_t i = 0; i < size; ++i) crc = table[(crc ^ bytes[i]) & 255] ^ (crc >> 8);
    return ~crc;
}

/// FNV-1a.
std::uint64_t hash_of(const void* data, std::size_t size, std::uint64_t hash = 1469598103934665603ull) {
    const auto* bytes = static_cast<const std::uint8_t*>(data);
    for (std::size_t i = 0; i < size; ++i) hash = (hash ^ bytes[i]) * 1099511628211ull;
    return hash;
}

template <class T>
void put(std::vector<std::uint8_t>& out, const T& value) {
    const auto* bytes = reinterpret_cast<const std::uint8_t*>(&value);
    out.insert(out.end(), bytes, bytes + sizeof value);
}
void put_pose(std::vector<std::uint8_t>& out, const Pose<double>& p) {
    for (double v : {p.position.x, p.position.y, p.position.z, p.rotation.w, p.rotation.x, p.rotation.y, p.rotation.z})
        put(out, v);
}

/// Reads from a payload; `good` turns false where it is too short.
struct Reader {
    const std::uint8_t* at;
    const std::uint8_t* end;
    bool good = true;
    template <class T>
    T get() {
        T value{};
        if (std::size_t(end - at) < sizeof value) {
            good = false;
            return value;
        }
        std::memcpy(&value, at, sizeof value);
        at += sizeof value;
        return value;
    }
    Pose<double> pose() {
        Pose<double> p;
        for (double* v :
             {&p.position.x, &p.position.y, &p.position.z, &p.rotation.w, &p.rotation.x, &p.rotation.y, &p.rotation.z})
            *v = get<double>();
        return p;
    }
};

bool read_step(const std::uint8_t* payload, std::size_t size, const RecordedRun& run, RecordedStep& step) {
    const std::size_t fingers = run.fingers.size(), objects = run.objects.size(), arrays = run.arrays.size();
    Reader in{payload, payload + size};
    step.time = in.get<double>();
    for (std::size_t i = 0; i < fingers; ++i) {
        TrackerPose::Sample s;
        s.valid = in.get<std::uint8_t>() != 0;
        s.time = in.get<double>();
        s.pose = in.pose();
        step.inputs.fingers.push_back(s);
    }
    for (std::size_t i = 0; i < objects; ++i) step.inputs.objects.push_back(in.pose());
    for (std::size_t i = 0; i < arrays; ++i) step.outcome.hashes.push_back(in.get<std::uint64_t>());
    for (std::size_t i = 0; i < fingers; ++i) {
        const double x = in.get<double>(), y = in.get<double>(), z = in.get<double>();
        step.outcome.forces.push_back({x, y, z});
    }
    if (run.governed) {
        step.inputs.preset = in.get<std::uint8_t>();
        if (step.inputs.preset >= int(preset_names().size())) return false;
    }
    return in.good && in.at == in.end;
}

}  // namespace

std::vector<std::string> array_names(const Simulation& s) {
    std::vector<std::string> names;
    for (const Skin& skin : s.world.skins)
        for (const char* array : {"skin positions", "contact forces"}) names.push_back(skin.name + ": " + array);
    for (const Matching& m : s.world.matchings)
        names.push_back(s.world.skins.find(m.finger)->name + ": device configuration");
    for (const RigidShape& o : s.world.shapes)
        if (o.body >= 0) names.push_back(o.name + ": pose");
    return names;
}

StepOutcome outcome_of(const Simulation& s) {
    StepOutcome out;
    for (const EntityId finger : s.fingers) {
        const std::vector<Point> x = finger_positions(s.world, finger);
        const ContactSurface& c = *s.world.contact_surfaces.find(finger);
        out.hashes.push_back(hash_of(x.data(), x.size() * sizeof x[0]));
        out.hashes.push_back(hash_of(c.force.data(), c.force.size() * sizeof c.force[0]));
        out.forces.push_back(c.total);
    }
    for (const Matching& m : s.world.matchings)
        out.hashes.push_back(hash_of(m.result.w.data(), std::size_t(m.result.w.size()) * sizeof(double)));
    for (const RigidShape& o : s.world.shapes)
        if (o.body >= 0) out.hashes.push_back(hash_of(&o.pose, sizeof o.pose));
    return out;
}

RunWriter::RunWriter(const std::filesystem::path& path, const Simulation& s, const std::vector<std::string>& overrides)
    : path_(path), file_(std::fopen(path.c_str(), "wb"), &std::fclose) {
    if (!file_) throw InputError(path.string() + ": cannot be written: " + std::strerror(errno));
    std::vector<std::string> fingers, objects;
    for (const Skin& skin : s.world.skins) fingers.push_back(skin.name);
    for (const RigidShape& o : s.world.shapes) objects.push_back(o.name);
    const nlohmann::json header{{"scene", std::filesystem::absolute(s.scene.file).lexically_normal().string()},
                                {"text", read_file(s.scene.file)},
                                {"overrides", overrides},
                                {"fingers", fingers},
                                {"objects", objects},
                                {"arrays", array_names(s)},
                                {"governed", s.governor.has_value()}};
    const std::string json = header.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
    std::fwrite(magic, 1, sizeof magic, file_.get());
    frame(header_kind, {json.begin(), json.end()});
}

void RunWriter::frame(std::uint32_t kind, const std::vector<std::uint8_t>& payload) {
    std::vector<std::uint8_t> bytes;
    bytes.reserve(payload.size() + 12);
    put(bytes, std::uint32_t(payload.size()));
    put(bytes, kind);
    bytes.insert(bytes.end(), payload.begin(), payload.end());
    put(bytes, crc32(bytes.data() + 4, bytes.size() - 4));
    // One write and no buffer kept: a killed process loses nothing that was recorded.
    if (std::fwrite(bytes.data(), 1, bytes.size(), file_.get()) != bytes.size() || std::fflush(file_.get()) != 0)
        throw InputError(path_.string() + ": cannot be written any further: " + std::strerror(errno));
}

void RunWriter::record(const StepInputs& inputs, const Simulation& s) {
    std::vector<std::uint8_t> payload;
    put(payload, s.world.time);
    for (const TrackerPose::Sample& sample : inputs.fingers) {
        put(payload, std::uint8_t(sample.valid));
        put(payload, sample.time);
        put_pose(payload, sample.pose);
    }
    for (const Pose<double>& pose : inputs.objects) put_pose(payload, pose);
    const StepOutcome outcome = outcome_of(s);
    for (std::uint64_t hash : outcome.hashes) put(payload, hash);
    for (const Vec3<double>& f : outcome.forces) put(payload, f.x), put(payload, f.y), put(payload, f.z);
    if (s.governor) put(payload, std::uint8_t(inputs.preset));
    frame(step_kind, payload);
}

Scene recorded_scene(const RecordedRun& run, const std::filesystem::path& file) {
    const std::string remedy =
        "; `palpate replay " + file.string() + " --extract " + run.scene + "` puts back what it said then";
    if (!std::filesystem::exists(run.scene)) throw InputError(run.scene + ": is gone" + remedy);
    if (read_file(run.scene) != run.text)
        throw InputError(run.scene + ": has changed since the run was recorded" + remedy);
    return load_scene(run.scene, run.overrides);
}

RecordedRun read_run(const std::filesystem::path& path) {
    const std::string raw = read_file(path);
    const auto* bytes = reinterpret_cast<const std::uint8_t*>(raw.data());
    const std::string what = path.string() + ": not a recorded run (`palpate run SCENE --record FILE` writes one): ";
    if (raw.size() < sizeof magic || std::memcmp(bytes, magic, sizeof magic) != 0)
        throw InputError(what + "it does not begin with \"palpate1\"");
    RecordedRun run;
    std::size_t at = sizeof magic;
    bool has_header = false;
    while (raw.size() - at >= 12) {
        std::uint32_t size, kind, crc;
        std::memcpy(&size, bytes + at, 4);
        if (size > largest_frame || raw.size() - at < 12 + std::size_t(size)) break;
        std::memcpy(&kind, bytes + at + 4, 4);
        std::memcpy(&crc, bytes + at + 8 + size, 4);
        if (crc32(bytes + at + 4, 4 + std::size_t(size)) != crc) break;
        const std::uint8_t* payload = bytes + at + 8;
        if (!has_header) {
            const auto j = nlohmann::json::parse(payload, payload + size, nullptr, false);
            if (kind != header_kind || !j.is_object()) throw InputError(what + "its first frame is no header");
            try {
                run.scene = j.at("scene"), run.text = j.at("text");
                run.overrides = j.at("overrides").get<std::vector<std::string>>();
                run.arrays = j.at("arrays").get<std::vector<std::string>>();
                run.fingers = j.at("fingers").get<std::vector<std::string>>();
                run.objects = j.at("objects").get<std::vector<std::string>>();
                run.governed = j.value("governed", false);
            } catch (const nlohmann::json::exception& error) { throw InputError(what + error.what()); }
            has_header = true;
        } else if (kind == step_kind) {
            RecordedStep step;
            if (!read_step(payload, size, run, step)) break;
            run.steps.push_back(std::move(step));
        }
        at += 12 + std::size_t(size);
    }
    if (!has_header) throw InputError(what + "its header is incomplete");
    run.unread_bytes = raw.size() - at;
    return run;
}

}  // namespace palpate
