#include "scenes/fingers/finger_model.h"

#include <algorithm>
#include <sstream>

#include "meshes/finger_presets.h"
#include "meshes/input_error.h"
#include "meshes/layers.h"
#include "meshes/mesh_files.h"

namespace palpate {

namespace {

constexpr double mm = 1e-3, kPa = 1e3;
const std::vector<std::string> material_names{"corotational", "st-venant-kirchhoff", "neo-hookean"};  // as Material

void read_shape(Section s, FingerMeshRequest& r) {
    if (!s) return;
    r.source = FingerMeshRequest::Source::parametric;
    if (s.has("finger")) r.shape = finger_shape(s.choice("finger", "index", finger_shape_names()));
    r.shape.length = s.number("length_mm", r.shape.length / mm, 10, 60, mm);
    r.shape.width = s.number("width_mm", r.shape.width / mm, 6, 40, mm);
    r.shape.thickness = s.number("thickness_mm", r.shape.thickness / mm, 6, 35, mm);
    r.shape.pad_bulge = s.number("pad_bulge", r.shape.pad_bulge, 0, 0.5);
    r.shape.nail_drop = s.number("nail_drop", r.shape.nail_drop, 0, 0.5);
    s.finish();
}

void read_mesh_file(Section s, const std::filesystem::path& folder, bool has_shape, FingerMeshRequest& r) {
    if (!s) return;
    const std::string surface = s.text("surface", ""), tets = s.text("tets", "");
    if (surface.empty() == tets.empty()) s.complain("surface", "expected either surface = \"...\" or tets = \"...\"");
    if (has_shape) s.complain("surface", "a finger has either a shape or a mesh, not both");
    r.source = tets.empty() ? FingerMeshRequest::Source::surface : FingerMeshRequest::Source::tets;
    r.file = (folder / (tets.empty() ? surface : tets)).lexically_normal().string();
    if (s.has("unit")) r.unit = s.choice("unit", "mm", {"m", "cm", "mm"});
    r.keep_frame = s.boolean("keep_frame", r.keep_frame);
    s.finish();
}

void read_bone(Section s, FingerMeshRequest& r) {
    if (!s) return;
    r.bone_nodes = s.integers("nodes");
    r.half_space = s.has("normal");
    const Vec3<double> n = s.vector("normal", {0, 0, 1}, 1e3);
    r.half_space_normal = {n.x, n.y, n.z};
    r.half_space_offset = s.number("offset_mm", 0, -1000, 1000, mm);
    r.regions.nail = s.number("nail", r.regions.nail, 0, 1);
    r.regions.cut = s.number("cut", r.regions.cut, 0, 1);
    r.regions.phalanx_length = s.number("phalanx_length", r.regions.phalanx_length, 0, 1);
    r.regions.phalanx_height = s.number("phalanx_height", r.regions.phalanx_height, 0, 1);
    r.regions.phalanx_radius = s.number("phalanx_radius", r.regions.phalanx_radius, 0, 1);
    s.finish();
}

void read_layers(Section& owner, const FingerSpec& below, std::vector<TissueLayer>& layers) {
    auto tables = owner.tables("layer");
    if (!tables.empty()) layers.clear();
    for (Section& s : tables) {
        TissueLayer l;
        if (!s.has("thickness_mm")) s.complain("thickness_mm", "a layer needs its thickness");
        l.thickness = s.number("thickness_mm", 1, 0.01, 20, mm);
        l.young_modulus = s.number("young_kPa", below.young_modulus / kPa, 1e-3, 1e6, kPa);
        l.limit_low = s.number("low", below.limit_low, 0.011, 0.999);
        l.limit_high = s.number("high", below.limit_high, 1.001, 99);
        s.finish();
        layers.push_back(l);
    }
}

}  // namespace

void read_material(Section s, FingerSpec& f) {
    const std::string kind = s.choice("kind", material_names[std::size_t(f.material)], material_names);
    f.material = Material(std::find(material_names.begin(), material_names.end(), kind) - material_names.begin());
    f.young_modulus = s.number("young_kPa", f.young_modulus / kPa, 1e-3, 1e6, kPa);
    f.poisson_ratio = s.number("poisson", f.poisson_ratio, 0, 0.4999);
    f.density = s.number("density_kg_per_m3", f.density, 1, 1e5);
    s.finish();
}

void read_limits(Section s, FingerSpec& f) {
    if (!s) return;
    f.has_limits = s.boolean("enabled", true);
    f.limit_low = s.number("low", f.limit_low, 0, 1);
    f.limit_high = s.number("high", f.limit_high, 1, 100);
    if (f.limit_low >= 1 || f.limit_high <= 1)
        s.complain("low", "limits must leave room around the rest shape: low < 1 < high");
    s.finish();
}

void read_finger_model(Section& s, const std::filesystem::path& folder, FingerModel& m) {
    read_material(s.table("material"), m.spec);
    read_limits(s.table("limits"), m.spec);
    Section shape = s.table("shape");
    read_shape(shape, m.mesh);
    read_mesh_file(s.table("mesh"), folder, bool(shape), m.mesh);
    read_bone(s.table("bone"), m.mesh);
    read_layers(s, m.spec, m.layers);
    m.mesh.elements = s.integer("elements", m.mesh.elements, 20, 200000);
}

std::vector<std::string> finger_preset_names() {
    std::vector<std::string> names;
    for (const FingerPreset& p : finger_presets()) names.emplace_back(p.name);
    return names;
}

void read_named_finger(const std::string& name, const std::filesystem::path& folder, FingerModel& m,
                       Problems& problems) {
    const bool is_file = name.size() > 5 && name.ends_with(".toml");
    Problems own{is_file ? (folder / name).lexically_normal() : std::filesystem::path(name), {}};
    try {
        toml::table table;
        if (is_file) {
            if (!std::filesystem::is_regular_file(own.file)) throw InputError(own.file.string() + ": no such file");
            table = toml::parse_file(own.file.string());
        } else {
            const auto& presets = finger_presets();
            const auto it = std::find_if(presets.begin(), presets.end(), [&](auto& p) { return p.name == name; });
            if (it == presets.end()) {
                std::string all;
                for (const FingerPreset& p : presets) all += (all.empty() ? "" : ", ") + std::string(p.name);
                throw InputError("expected the name of a finger (" + all +
                                 "), or a file that ends with .toml, found \"" + name + "\"");
            }
            table = toml::parse(it->text);
        }
        Section root(&table, "", own);
        m.title = root.text("title", m.title);
        m.source = root.text("source", m.source);
        read_finger_model(root, own.file.parent_path(), m);
        root.finish();
    } catch (const toml::parse_error& error) {
        const auto& at = error.source().begin;
        own.messages.push_back(own.file.string() + ":" + std::to_string(at.line) + ":" + std::to_string(at.column) +
                               ": " + std::string(error.description()));
    } catch (const InputError& error) {
        own.messages.insert(own.messages.end(), error.messages.begin(), error.messages.end());
    }
    problems.messages.insert(problems.messages.end(), own.messages.begin(), own.messages.end());
}

void apply_layers(const std::vector<TissueLayer>& layers, FingerSpec& f) {
    f.element_young.clear(), f.element_low.clear(), f.element_high.clear();
    if (layers.empty()) return;
    std::vector<double> thicknesses;
    for (const TissueLayer& l : layers) thicknesses.push_back(l.thickness);
    for (const std::vector<double>& shares : layer_shares(f.mesh, thicknesses)) {
        double young = shares.back() * f.young_modulus, low = shares.back() * f.limit_low,
               high = shares.back() * f.limit_high;
        for (std::size_t k = 0; k < layers.size(); ++k) {
            young += shares[k] * layers[k].young_modulus;
            low += shares[k] * layers[k].limit_low;
            high += shares[k] * layers[k].limit_high;
        }
        f.element_young.push_back(young);
        f.element_low.push_back(low);
        f.element_high.push_back(high);
    }
}

FingerSpec build_finger(const FingerModel& m, FingerTemplates& templates, std::string& note) {
    FingerSpec f = m.spec;
    f.mesh = make_finger_mesh(m.mesh, templates, note);
    apply_layers(m.layers, f);
    if (!m.layers.empty()) note += ", " + std::to_string(m.layers.size() + 1) + " layers of tissue";
    return f;
}

void write_finger_file(const std::filesystem::path& path, const FingerModel& m,
                       const std::vector<std::string>& comment) {
    std::ostringstream out;
    auto quoted = [](const std::string& s) {
        std::ostringstream text;
        text << toml::value<std::string>(s);
        return text.str();
    };
    out.precision(6);
    for (const std::string& line : comment) out << "# " << line << "\n";
    if (!m.title.empty()) out << "title = " << quoted(m.title) << "\n";
    if (!m.source.empty()) out << "source = " << quoted(m.source) << "\n";
    const FingerMeshRequest& r = m.mesh;
    out << "elements = " << r.elements << "\n";
    if (r.source == FingerMeshRequest::Source::parametric)
        out << "shape = { length_mm = " << r.shape.length / mm << ", width_mm = " << r.shape.width / mm
            << ", thickness_mm = " << r.shape.thickness / mm << ", pad_bulge = " << r.shape.pad_bulge
            << ", nail_drop = " << r.shape.nail_drop << " }\n";
    else
        out << "mesh = { " << (r.source == FingerMeshRequest::Source::tets ? "tets" : "surface") << " = "
            << quoted(std::filesystem::absolute(r.file).string())
            << (r.unit.empty() ? "" : ", unit = \"" + r.unit + "\"") << (r.keep_frame ? ", keep_frame = true" : "")
            << " }\n";
    if (!r.bone_nodes.empty()) {
        out << "bone = { nodes = [";
        for (std::size_t i = 0; i < r.bone_nodes.size(); ++i) out << (i ? ", " : "") << r.bone_nodes[i];
        out << "] }\n";
    } else if (r.half_space) {
        out << "bone = { normal = [" << r.half_space_normal[0] << ", " << r.half_space_normal[1] << ", "
            << r.half_space_normal[2] << "], offset_mm = " << r.half_space_offset / mm << " }\n";
    } else {
        out << "bone = { cut = " << r.regions.cut << ", nail = " << r.regions.nail
            << ", phalanx_length = " << r.regions.phalanx_length << ", phalanx_height = " << r.regions.phalanx_height
            << ", phalanx_radius = " << r.regions.phalanx_radius << " }\n";
    }
    out << "material = { kind = \"" << material_names[std::size_t(m.spec.material)]
        << "\", young_kPa = " << m.spec.young_modulus / kPa << ", poisson = " << m.spec.poisson_ratio
        << ", density_kg_per_m3 = " << m.spec.density << " }\n";
    if (m.spec.has_limits) out << "limits = { low = " << m.spec.limit_low << ", high = " << m.spec.limit_high << " }\n";
    for (const TissueLayer& l : m.layers)
        out << "\n[[layer]]\nthickness_mm = " << l.thickness / mm << "\nyoung_kPa = " << l.young_modulus / kPa
            << "\nlow = " << l.limit_low << "\nhigh = " << l.limit_high << "\n";
    write_file(path, out.str());
}

}  // namespace palpate
