#include "bench/generated_scene.h"

#include <random>
#include <sstream>

namespace palpate {

std::string generated_scene(unsigned number) {
    std::mt19937 random(1000 + number);
    auto between = [&](double low, double high) { return std::uniform_real_distribution<double>(low, high)(random); };
    auto one_of = [&](std::initializer_list<const char*> words) { return *(words.begin() + random() % words.size()); };
    std::ostringstream out;
    out << "duration_s = 0.6\n[limits]\nlow = " << between(0.5, 0.75) << "\nhigh = " << between(1.25, 1.6)
        << "\n[[object]]\nname = \"thing\"\n";
    const std::string kind = one_of({"plane", "sphere", "box", "cylinder", "capsule"});
    out << "kind = \"" << kind << "\"\n";
    double top = 0;  // of the object below the finger [mm]
    if (kind == "sphere") {
        top = between(5, 40);
        out << "radius_mm = " << top << "\n";
    }
    if (kind == "box") {
        const double size = between(8, 40);
        top = 0.5 * size;
        out << "size_mm = [" << between(8, 60) << ", " << between(8, 60) << ", " << size << "]\n";
    }
    if (kind == "cylinder" || kind == "capsule") {
        top = between(4, 20);
        out << "radius_mm = " << top << "\nlength_mm = " << between(20, 60) << "\n";
    }
    out << "position_mm = [" << between(-3, 3) << ", " << between(-3, 3) << ", " << -top << "]\n";
    if (kind == "cylinder" || kind == "capsule") out << "rotation_deg = [90, 0, " << between(-90, 90) << "]\n";
    if (random() % 2) out << "friction = " << between(0.1, 1.0) << "\n";
    out << "[[finger]]\nname = \"finger\"\nshape = { finger = \""
        << one_of({"thumb", "index", "middle", "ring", "little"}) << "\" }\nelements = " << 250 + random() % 400
        << "\nmaterial = { young_kPa = " << between(10, 60) << ", poisson = " << between(0.2, 0.47)
        << " }\ndevice = { kind = \"chinello-3rrs\" }\n";
    // Down in 0.25 s, then aside.
    const double tilt = between(-20, 20), turn = between(-20, 20), depth = between(1.5, 3.5);
    auto keyframe = [&](double t, double x, double y, double z) {
        out << "    { t_s = " << t << ", position_mm = [" << x << ", " << y << ", " << z << "], rotation_deg = ["
            << turn << ", " << tilt << ", 0] },\n";
    };
    const double aside = between(0, 6), along = between(-3, 3);
    out << "track = [\n";
    keyframe(0, 0, 0, 9.5);
    keyframe(0.25, 0, 0, 8.5 - depth);
    keyframe(0.35, 0, 0, 8.5 - depth);
    keyframe(0.6, along, aside, 8.5 - depth);
    out << "]\n";
    return out.str();
}

}  // namespace palpate
