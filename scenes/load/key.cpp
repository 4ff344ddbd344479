#include "scenes/load/key.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <sstream>

#include "meshes/plain_numbers.h"

namespace palpate {

namespace {

/// Insertions, deletions, replacements and swaps of neighbours that make one word of the other.
std::size_t edit_distance(const std::string& a, const std::string& b) {
    std::vector<std::vector<std::size_t>> d(a.size() + 1, std::vector<std::size_t>(b.size() + 1));
    for (std::size_t i = 0; i <= a.size(); ++i) d[i][0] = i;
    for (std::size_t j = 0; j <= b.size(); ++j) d[0][j] = j;
    for (std::size_t i = 1; i <= a.size(); ++i)
        for (std::size_t j = 1; j <= b.size(); ++j) {
            d[i][j] = std::min({d[i - 1][j] + 1, d[i][j - 1] + 1, d[i - 1][j - 1] + (a[i - 1] != b[j - 1])});
            if (i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1])
                d[i][j] = std::min(d[i][j], d[i - 2][j - 2] + 1);
        }
    return d[a.size()][b.size()];
}

/// Twelve digits, so that a bound does not end in ...0001.
double rounded(double x) {
    char text[40];
    plain_snprintf(text, sizeof text, "%.12g", x);
    return plain_strtod(text, nullptr);
}

}  // namespace

Range in(const Unit& unit, const Range& si) {
    Range r{rounded(si.low / unit.si), rounded(si.high / unit.si)};
    if (r.low * unit.si < si.low) r.low = rounded(r.low + 1e-11 * std::abs(r.low));
    if (r.high * unit.si > si.high) r.high = rounded(r.high - 1e-11 * std::abs(r.high));
    return r;
}

std::string joined(const std::vector<std::string>& words) {
    std::string all;
    for (const auto& w : words) all += (all.empty() ? "" : ", ") + w;
    return all;
}

std::string number_text(double x) {
    PlainText out;
    out << x;
    return out.str();
}

bool is_much_like(const std::string& word, const std::string& known) {
    if (word.size() >= 100) return false;  // nobody meant a word by a longer one, and comparing takes long
    const bool without_unit = known.rfind(word + "_", 0) == 0;
    return without_unit || edit_distance(known, word) <= std::max<std::size_t>(2, word.size() / 4);
}

std::string nearest_or_all(const std::string& word, const std::vector<std::string>& known) {
    if (word.size() < 100) {
        std::string nearest;
        for (const std::string& k : known)
            if (k.rfind(word + "_", 0) == 0) return "did you mean '" + k + "'?";
        for (const std::string& k : known)
            if (edit_distance(k, word) <= std::max<std::size_t>(2, word.size() / 4) &&
                (nearest.empty() || edit_distance(k, word) < edit_distance(nearest, word)))
                nearest = k;
        if (!nearest.empty()) return "did you mean '" + nearest + "'?";
    }
    return "known here: " + joined(known);
}

}  // namespace palpate
