#include "scenes/viewer/drawn_hands.h"

#include <nlohmann/json.hpp>

#include "scenes/viewer/bytes.h"

namespace palpate {

nlohmann::json hand_skin_json() {
    const HandSkin& skin = hand_skin();
    nlohmann::json vertices = nlohmann::json::array(), bones = nlohmann::json::array(),
                   second = nlohmann::json::array();
    for (const Point& p : skin.surface.vertices)
        for (const double x : p) vertices.push_back(std::lround(1e5 * x));
    for (const auto& pair : skin.bones)
        for (const int bone : pair) bones.push_back(bone);
    for (const double share : skin.second) second.push_back(std::lround(100 * share));
    return {{"vertices", vertices}, {"bones", bones}, {"second", second}};
}

nlohmann::json hands_json(const Scene& scene) {
    nlohmann::json out = nlohmann::json::array();
    for (const HandParts& parts : hands_of(scene)) {
        nlohmann::json triangles = nlohmann::json::array();
        for (const auto& t : drawn_faces(parts))  // mirrored, a left hand's are turned over
            for (const std::size_t k : {0, parts.left ? 2 : 1, parts.left ? 1 : 2}) triangles.push_back(t[k]);
        out.push_back({{"left", parts.left}, {"triangles", triangles}});
    }
    return out;
}

DrawnHands::DrawnHands(const Simulation& s) {
    for (const HandParts& parts : hands_of(s.scene)) hands_.emplace_back(s, parts);
}

void DrawnHands::append(std::vector<std::uint8_t>& out, const Simulation& s) {
    for (HandPoser& hand : hands_)
        for (const Eigen::Affine3d& bone : hand.pose(s)) {
            for (int row = 0; row < 3; ++row)
                for (int column = 0; column < 3; ++column)
                    put_scaled<std::int16_t>(out, bone.linear()(row, column), 1.0 / 4096);
            for (int d = 0; d < 3; ++d) put(out, float(bone.translation()[d]));
        }
}

}  // namespace palpate
