// Descriptions in C become the text of a scene, so that there is one loader with one set of checks.

#include <cmath>
#include <sstream>

#include "meshes/input_error.h"
#include "meshes/plain_numbers.h"
#include "scenes/api/guard.h"
#include "scenes/api/session.h"

namespace palpate::api {

namespace {

constexpr double pi = 3.14159265358979323846, degrees = 180 / pi;
constexpr std::int32_t most_rows = 10000;

std::string quoted(const char* text) {
    std::string out = "\"";
    for (const char* c = text; *c; ++c) {
        const auto byte = static_cast<unsigned char>(*c);
        char escaped[8];
        if (*c == '"' || *c == '\\')
            (out += '\\') += *c;
        else if (byte < 32 || byte == 127)
            plain_snprintf(escaped, sizeof escaped, "\\u%04x", byte), out += escaped;
        else
            out += *c;
    }
    return out + "\"";
}

/// TOML has nan and inf, and the loader says where they stand.
struct Number {
    double value;
};
std::ostream& operator<<(std::ostream& out, Number n) {
    char text[40];
    plain_snprintf(text, sizeof text, "%.17g", n.value);
    std::string s = text;
    if (std::isfinite(n.value) && s.find_first_of(".e") == std::string::npos) s += ".0";
    return out << s;
}

void put_vector(std::ostream& out, const char* key, double x, double y, double z) {
    out << key << " = [" << Number{x} << ", " << Number{y} << ", " << Number{z} << "]";
}

/// position_mm and rotation_deg of a pose.
void put_pose(std::ostream& out, const double* p, const std::string& who, const char* between) {
    const double length = std::sqrt(p[3] * p[3] + p[4] * p[4] + p[5] * p[5] + p[6] * p[6]);
    if (!(length > 1e-6) || !std::isfinite(length))
        throw InputError(who + ": the rotation of its pose must be a quaternion w x y z that is not zero");
    const double w = p[3] / length, x = p[4] / length, y = p[5] / length, z = p[6] / length;
    // Half the sum and half the difference of yaw and roll, each from its own half of the quaternion: where the pitch
    // is 90 degrees one of them means nothing, and the other one still says the whole rotation.
    const double sum = std::atan2(z + x, w - y), difference = std::atan2(z - x, w + y);
    const double pitch = 2 * (std::atan2(std::hypot(w + y, z - x), std::hypot(w - y, z + x)) - 0.25 * pi);
    const double roll = std::remainder(sum - difference, 2 * pi), yaw = std::remainder(sum + difference, 2 * pi);
    put_vector(out, "position_mm", 1e3 * p[0], 1e3 * p[1], 1e3 * p[2]);
    out << between;
    put_vector(out, "rotation_deg", degrees * roll, degrees * pitch, degrees * yaw);
}

void put_finger(std::ostream& out, const PalpateFingerDef* given, const std::string& who) {
    PalpateFingerDef f{};
    palpate_default_finger_def(&f, sizeof f);
    if (!read_struct(given, f)) throw InputError(who + ": " + wrong_size);
    out << "[[finger]]\nname = " << quoted(f.name ? f.name : who.c_str()) << "\n";
    if (f.finger) out << "finger = " << quoted(f.finger) << "\n";
    if (f.elements != 0) out << "elements = " << f.elements << "\n";
    if (f.young_modulus != 0) out << "material = { young_kPa = " << Number{1e-3 * f.young_modulus} << " }\n";
    if (f.device) {
        out << "device = { kind = " << quoted(f.device);
        if (f.method) out << ", method = " << quoted(f.method);
        out << " }\n";
    }
    out << "track = [ { t_s = 0, ";
    put_pose(out, f.pose, who, ", ");
    out << " } ]\n";
}

void put_object(std::ostream& out, const PalpateObjectDef* given, const std::string& who) {
    static constexpr const char* shapes[] = {"plane", "box", "sphere", "capsule", "cylinder", "mesh"};
    PalpateObjectDef o{};
    palpate_default_object_def(&o, sizeof o);
    if (!read_struct(given, o)) throw InputError(who + ": " + wrong_size);
    if (o.shape < PALPATE_PLANE || o.shape > PALPATE_MESH)
        throw InputError(who + ": shape must be one of PALPATE_PLANE to PALPATE_MESH, found " +
                         std::to_string(o.shape));
    out << "[[object]]\nname = " << quoted(o.name ? o.name : who.c_str()) << "\nkind = \"" << shapes[o.shape] << "\"\n";
    if (o.file) out << "file = " << quoted(o.file) << "\n";
    const double* d = o.dimensions;
    if (o.shape == PALPATE_BOX) {
        put_vector(out, "size_mm", 1e3 * d[0], 1e3 * d[1], 1e3 * d[2]);
        out << "\n";
    } else if (o.shape != PALPATE_PLANE && o.shape != PALPATE_MESH) {
        out << "radius_mm = " << Number{1e3 * d[0]} << "\n";
        if (o.shape != PALPATE_SPHERE) out << "length_mm = " << Number{1e3 * d[1]} << "\n";
    }
    put_pose(out, o.pose, who, "\n");
    out << "\nfriction = " << Number{o.friction} << "\n";
    if (o.stiffness != 0) out << "stiffness_kPa_per_mm = " << Number{1e-6 * o.stiffness} << "\n";
    if (o.mass != 0) out << "mass_g = " << Number{1e3 * o.mass} << "\n";
    if (o.young_modulus == 0) return;
    out << "soft = { young_kPa = " << Number{1e-3 * o.young_modulus};
    if (o.poisson != 0) out << ", poisson = " << Number{o.poisson};
    if (o.elements != 0) out << ", elements = " << o.elements;
    out << ", fixed = " << quoted(o.fixed ? o.fixed : "bottom");
    if (o.fixed_depth != 0) out << ", fixed_mm = " << Number{1e3 * o.fixed_depth};
    out << " }\n";
}

/// Of a list of structs of the caller's version.
template <class Struct>
const Struct* entry(const Struct* list, std::int32_t i) {
    return reinterpret_cast<const Struct*>(reinterpret_cast<const char*>(list) +
                                           std::ptrdiff_t(i) * std::ptrdiff_t(list->size));
}

}  // namespace

std::string finger_text(const PalpateFingerDef* def, const std::string& name) {
    PlainText out;
    put_finger(out, def, name);
    return out.str();
}

std::string object_text(const PalpateObjectDef* def, const std::string& name) {
    PlainText out;
    put_object(out, def, name);
    return out.str();
}

std::string scene_text(const PalpateSceneDef& given) {
    PalpateSceneDef scene{};
    palpate_default_scene_def(&scene, sizeof scene);
    if (!read_struct(&given, scene)) throw InputError(wrong_size);
    const auto check = [](const char* what, std::int32_t count, const void* list) {
        if (count < 0 || count > most_rows || (count > 0 && !list))
            throw InputError(std::string(what) + ": expected a list of 0 to " + std::to_string(most_rows) + ", found " +
                             std::to_string(count) + (list ? "" : " at NULL"));
    };
    check("fingers", scene.finger_count, scene.fingers);
    check("objects", scene.object_count, scene.objects);
    PlainText out;
    out << "dt_ms = " << Number{1e3 * scene.dt} << "\n";
    put_vector(out, "gravity_m_per_s2", scene.gravity[0], scene.gravity[1], scene.gravity[2]);
    out << "\n";
    if (scene.more) out << scene.more << "\n";
    if (scene.preset) out << "[solver]\npreset = " << quoted(scene.preset) << "\n";
    for (std::int32_t i = 0; i < scene.object_count; ++i)
        put_object(out, entry(scene.objects, i), "object " + std::to_string(i));
    for (std::int32_t i = 0; i < scene.finger_count; ++i)
        put_finger(out, entry(scene.fingers, i), "finger " + std::to_string(i));
    return out.str();
}

}  // namespace palpate::api

int32_t palpate_default_finger_def(PalpateFingerDef* def, int32_t size) {
    using namespace palpate::api;
    if (!def) return fail(PALPATE_ERROR_ARGUMENT, "def is NULL");
    PalpateFingerDef own{};
    own.finger = "index-median";
    own.pose[3] = 1;
    def->size = size;
    return write_struct(own, def) ? PALPATE_OK : fail(PALPATE_ERROR_ARGUMENT, wrong_size);
}

int32_t palpate_default_object_def(PalpateObjectDef* def, int32_t size) {
    using namespace palpate::api;
    if (!def) return fail(PALPATE_ERROR_ARGUMENT, "def is NULL");
    PalpateObjectDef own{};
    own.pose[3] = 1;
    def->size = size;
    return write_struct(own, def) ? PALPATE_OK : fail(PALPATE_ERROR_ARGUMENT, wrong_size);
}

int32_t palpate_default_scene_def(PalpateSceneDef* def, int32_t size) {
    using namespace palpate::api;
    if (!def) return fail(PALPATE_ERROR_ARGUMENT, "def is NULL");
    PalpateSceneDef own{};
    own.dt = 0.001;
    own.gravity[2] = -9.81;
    own.preset = "balanced";
    def->size = size;
    return write_struct(own, def) ? PALPATE_OK : fail(PALPATE_ERROR_ARGUMENT, wrong_size);
}
