#include "scenes/recording/run_file.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "meshes/input_error.h"
#include "meshes/mesh_files.h"

namespace palpate {

namespace {

using Payload = std::vector<std::uint8_t>;
using Names = std::vector<std::string>;

constexpr std::string_view magic = "palpate2";
enum FrameKind : std::uint32_t {
    run_frame = 1,
    step_frame = 3,
    arrays_frame = 4,
    settings_frame = 5,
    end_frame = 6,
    cuts_frame = 7
};

void put_pose(Payload& out, const Pose<double>& p) {
    for (double v : {p.position.x, p.position.y, p.position.z, p.rotation.w, p.rotation.x, p.rotation.y, p.rotation.z})
        put(out, v);
}

void put_vector(Payload& out, const Vec3<double>& v) { put(out, v.x), put(out, v.y), put(out, v.z); }

Payload json_payload(const nlohmann::json& j) {
    const std::string text = j.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
    return {text.begin(), text.end()};
}

std::vector<char> moving_objects(const Simulation& s) {
    std::vector<char> moving;
    for (const VirtualObject& o : s.world.shapes) moving.push_back(o.body >= 0);
    return moving;
}

}  // namespace

std::vector<std::string> array_names(const Simulation& s) {
    std::vector<std::string> names;
    for (const Skin& skin : s.world.skins)
        for (const char* array : {"skin positions", "contact forces"}) names.push_back(skin.name + ": " + array);
    for (const Matching& m : s.world.matchings)
        names.push_back(s.world.skins.find(m.finger)->name + ": device configuration");
    for (const VirtualObject& o : s.world.shapes)
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
    for (std::size_t row = 0; row < s.world.shapes.size(); ++row) {
        const VirtualObject& o = s.world.shapes[row];
        if (o.body < 0) continue;
        out.hashes.push_back(hash_of(&o.pose, sizeof o.pose));
        out.moved.push_back({int(row), o.pose});
    }
    return out;
}

RunWriter::RunWriter(const std::filesystem::path& path, const Simulation& s, const std::vector<std::string>& overrides)
    : file_(path, magic) {
    begin(s, overrides);
    if (!failure().empty()) throw std::runtime_error(failure());
}

void RunWriter::begin(const Simulation& s, const std::vector<std::string>& overrides) {
    Names fingers, objects;
    for (const Skin& skin : s.world.skins) fingers.push_back(skin.name);
    for (const VirtualObject& o : s.world.shapes) objects.push_back(o.name);
    steps_ = 0;
    moving_ = moving_objects(s);
    nlohmann::json files = nlohmann::json::array();
    for (const FileStamp& f : stamps_of(s.scene.files))
        files.push_back({{"file", f.file}, {"bytes", f.bytes}, {"hash", f.hash}});
    file_.append(run_frame,
                 json_payload({{"version", 2},
                               {"scene", std::filesystem::absolute(s.scene.file).lexically_normal().string()},
                               {"text", s.scene.text ? *s.scene.text : read_file(s.scene.file)},
                               {"has_file", !s.scene.text},
                               {"files", files},
                               {"overrides", overrides},
                               {"fingers", fingers},
                               {"objects", objects},
                               {"arrays", array_names(s)},
                               {"governed", s.governor.has_value()},
                               {"fingers_touch", s.scene.spec.fingers_touch},
                               {"conforming", true},
                               {"patches_limited", true},
                               {"keeps_matrices", true},
                               {"spares_iterations", true},
                               {"fast_spares", true},
                               {"dt_s", s.world.solver.dt},
                               {"duration_s", s.scene.duration}}));
}

void RunWriter::change_settings(const Simulation&, const std::vector<std::string>& overrides) {
    file_.append(settings_frame, json_payload({{"overrides", overrides}}));
}

void RunWriter::record(const StepInputs& inputs, const Simulation& s) {
    if (!failure().empty()) return;
    if (const auto moving = moving_objects(s); moving != moving_) {
        moving_ = moving;
        file_.append(arrays_frame, json_payload({{"arrays", array_names(s)}}));
    }
    if (s.world.deadline.cut_short) {
        Payload cuts;
        for (const int pass : s.world.deadline.cuts) put(cuts, std::int32_t(pass));
        file_.append(cuts_frame, cuts);
    }
    const StepOutcome outcome = outcome_of(s);
    Payload out;
    put(out, std::uint64_t(s.world.step));
    put(out, s.world.time);
    put(out, std::int8_t(inputs.preset));
    for (std::size_t count :
         {inputs.fingers.size(), inputs.objects.size(), outcome.hashes.size(), outcome.moved.size()})
        put(out, std::uint32_t(count));
    for (std::size_t i = 0; i < inputs.fingers.size(); ++i) {
        put(out, std::uint8_t(inputs.fingers[i].valid));
        put(out, inputs.fingers[i].time);
        put_pose(out, inputs.fingers[i].pose);
        put_vector(out, outcome.forces[i]);
    }
    for (const Pose<double>& pose : inputs.objects) put_pose(out, pose);
    for (std::uint64_t hash : outcome.hashes) put(out, hash);
    for (const MovedObject& m : outcome.moved) {
        put(out, std::uint32_t(m.object));
        put_pose(out, m.pose);
    }
    file_.append(step_frame, out);
    ++steps_;
}

void RunWriter::finish() {
    Payload out;
    put(out, steps_);
    file_.append(end_frame, out);
}

Scene recorded_scene(const RecordedRun& run, const std::filesystem::path& file,
                     const std::vector<std::string>& overrides) {
    // In runs from before fingers touched each other, they did not; nor were their meshes conforming unsaid, nor
    // their limits those of patches; every matrix was a new one, and all iterations were spent. `fast` had one, and
    // steadied what shook.
    auto is_set = [&](const std::string& key) {
        const auto names = [&](const std::string& text) { return text.find(key) != std::string::npos; };
        return names(run.text) || std::any_of(overrides.begin(), overrides.end(), names);
    };
    auto as_then = [&](Scene scene) {
        if (SolverSettings& v = scene.spec.solver; !run.fast_spares && scene.preset == 0) {
            if (!is_set("newton_iterations")) v.newton_iterations = 1;
            if (!is_set("unbalanced_share")) v.unbalanced_share = 0;
            if (!is_set("steadying_iterations")) v.steadying_iterations = 8;
        }
        scene.spec.fingers_touch = scene.spec.fingers_touch && run.fingers_touch;
        for (const std::string& change : changes_of(run.files, "the run was recorded"))
            scene.warnings.push_back(change);
        return scene;
    };
    std::vector<std::string> settings = overrides;
    if (!run.keeps_matrices) settings.insert(settings.begin(), "solver.stiffness_steps=1");
    if (!run.spares_iterations) settings.insert(settings.begin(), "solver.unbalanced_share=0");
    if (!run.patches_limited) settings.insert(settings.begin(), "mesh.limits=elements");
    if (!run.conforming) settings.insert(settings.begin(), {"mesh.kind=uniform", "mesh.patch=0"});
    if (!run.has_file) return as_then(load_scene_text(run.text, run.scene, settings));
    const std::string remedy =
        "; `palpate replay " + file.string() + " --extract " + run.scene + "` puts back what it said then";
    if (!std::filesystem::exists(run.scene)) throw InputError(run.scene + ": is gone" + remedy);
    if (read_file(run.scene) != run.text)
        throw InputError(run.scene + ": has changed since the run was recorded" + remedy);
    return as_then(load_scene(run.scene, settings));
}

}  // namespace palpate
