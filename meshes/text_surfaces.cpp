#include "meshes/text_surfaces.h"

#include <algorithm>
#include <cstdlib>
#include <map>
#include <sstream>
#include <string>

#include "meshes/plain_numbers.h"

namespace palpate {

namespace {

std::array<float, 3> read_point(std::istream& words) {
    std::array<float, 3> p{};
    std::string word;
    for (float& x : p) {
        words >> word;
        x = plain_strtof(word.c_str(), nullptr);
    }
    return p;
}

}  // namespace

TextSurface read_obj(std::istream& in) {
    TextSurface s;
    for (std::string line, word; std::getline(in, line);) {
        std::istringstream words(line);
        words >> word;
        if (word == "v") s.vertices.push_back(read_point(words));
        if (word != "f") continue;
        std::vector<int> face;
        while (words >> word) {  // vertex/texture/normal; from the last one backwards where it is negative
            const long named = std::strtol(word.c_str(), nullptr, 10);
            const int index = int(named > 0 ? named - 1 : long(s.vertices.size()) + named);
            if (std::find(face.begin(), face.end(), index) == face.end()) face.push_back(index);
        }
        if (face.size() > 2) s.faces.push_back(face);
    }
    return s;
}

TextSurface read_text_stl(std::istream& in) {
    TextSurface s;
    std::map<std::array<float, 3>, int> known;
    std::vector<int> face;
    for (std::string word; in >> word;) {
        if (word == "facet") face.clear();
        if (word == "vertex") {
            const auto [at, is_new] = known.try_emplace(read_point(in), int(s.vertices.size()));
            if (is_new) s.vertices.push_back(at->first);
            face.push_back(at->second);
        }
        if (word == "endfacet" && face.size() == 3 && face[0] != face[1] && face[1] != face[2] && face[2] != face[0])
            s.faces.push_back(face);
    }
    return s;
}

}  // namespace palpate
