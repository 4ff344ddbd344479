#include "scenes/viewer/report.h"

#include <algorithm>
#include <cstdio>
#include <cstring>
#include <nlohmann/json.hpp>

#include "meshes/mesh_files.h"
#include "meshes/plain_numbers.h"
#include "scenes/viewer/assets.h"

namespace palpate {

namespace {

std::string base64(const std::vector<std::uint8_t>& bytes) {
    static const char digits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    std::string out;
    out.reserve(bytes.size() * 4 / 3 + 4);
    for (std::size_t i = 0; i < bytes.size(); i += 3) {
        const std::size_t left = std::min<std::size_t>(3, bytes.size() - i);
        unsigned word = unsigned(bytes[i]) << 16;
        if (left > 1) word |= unsigned(bytes[i + 1]) << 8;
        if (left > 2) word |= bytes[i + 2];
        for (std::size_t k = 0; k < 4; ++k) out += k <= left ? digits[(word >> (18 - 6 * k)) & 63] : '=';
    }
    return out;
}

/// JSON inside a page: no "</script>" in a scene's text may end it.
std::string safe_in_html(const std::string& json) {
    std::string out;
    for (const char c : json) out += c == '<' ? std::string("\\u003c") : std::string(1, c);
    return out;
}

void replace(std::string& page, const std::string& mark, std::string_view text) {
    const std::size_t at = page.find(mark);
    page.replace(at, mark.size(), text);
}

}  // namespace

void ReportRecorder::record(const Simulation& s) {
    note_step(since_, s);
    if (s.world.time + 1e-9 < next_) return;
    if (!rendered_pads_) rendered_pads_ = std::make_unique<RenderedPads>(s);
    if (!hands_) hands_ = std::make_unique<DrawnHands>(s);
    fingers_ = s.fingers.size();
    append_frame(frames_, s, rendered_pads_->solve(s), *hands_, since_);
    ends_.push_back(frames_.size());
    since_ = {};
    if (frames_.size() > most_bytes_ && ends_.size() > 1) thin(1 / s.world.solver.dt);
    next_ += 1 / rate_;  // from when it was due: steps that do not divide the period lower no rate
    if (next_ <= s.world.time) next_ = s.world.time + 1 / rate_;
}

/// Of each two frames the later one stays, and tells of the steps of both (append_frame).
void ReportRecorder::thin(double steps_per_second) {
    std::vector<std::uint8_t> kept;
    std::vector<std::size_t> ends;
    const auto number = [](const std::uint8_t* at) {
        float x;
        std::memcpy(&x, at, sizeof x);
        return x;
    };
    for (std::size_t k = 1; k < ends_.size(); k += 2) {
        const std::uint8_t *earlier = frames_.data() + (k > 1 ? ends_[k - 2] : 0),
                           *later = frames_.data() + ends_[k - 1];
        const std::size_t begin = kept.size();
        kept.insert(kept.end(), later, static_cast<const std::uint8_t*>(frames_.data()) + ends_[k]);
        for (std::size_t i = 1; i < 3 + fingers_; ++i) {
            const float a = number(earlier + 4 * i), b = number(later + 4 * i), both = i == 1 ? std::max(a, b) : a + b;
            std::memcpy(&kept[begin + 4 * i], &both, sizeof both);
        }
        ends.push_back(kept.size());
    }
    if (ends_.size() % 2) {  // the last one has nothing after it yet
        kept.insert(kept.end(), frames_.begin() + std::ptrdiff_t(ends_[ends_.size() - 2]), frames_.end());
        ends.push_back(kept.size());
    }
    frames_ = std::move(kept);
    ends_ = std::move(ends);
    rate_ = 0.5 * std::min(rate_, steps_per_second);
}

std::string page_with(const nlohmann::json& data) {
    std::string page(assets::page());
    replace(page, "/*THREE*/", assets::three());
    replace(page, "/*ORBIT*/", assets::orbit_controls());
    replace(page, "/*FRAMES*/", assets::frames());
    replace(page, "/*PLOTS*/", assets::plots());
    replace(page, "/*DETAIL*/", assets::detail());
    replace(page, "/*SKIN*/", assets::skin());
    replace(page, "/*SHADOW*/", assets::shadow());
    replace(page, "/*SURROUNDINGS*/", assets::surroundings());
    replace(page, "/*SCENE*/", assets::scene());
    replace(page, "/*HAND*/", assets::hand());
    replace(page, "/*MECHANISM*/", assets::mechanism());
    replace(page, "/*NAMES*/", assets::names());
    replace(page, "/*PADS*/", assets::pads());
    replace(page, "/*VIEW*/", assets::view());
    replace(page, "/*KEYS*/", assets::keys());
    replace(page, "/*DATA*/", safe_in_html(data.dump()));
    return page;
}

std::string ReportRecorder::page(const Simulation& s, const Summary& summary, const PictureScales& scales) const {
    double converged = 0;
    for (const FingerSummary& f : summary.fingers) converged += f.converged_share / double(summary.fingers.size());
    char about[240];
    plain_snprintf(about, sizeof about,
                   "%.3g s in steps of %.3g ms, %.1f %% of them converged; %d frames shown (at most %.3g per second)",
                   s.world.time, 1e3 * s.world.solver.dt, 100 * converged, int(ends_.size()), rate_);
    nlohmann::json model = page_model(s);
    if (scales.most > 0) set_scales(model, scales);
    return page_with({{"model", model},
                      {"frames", base64(frames_)},
                      {"about", about},
                      {"summary", to_text(summary)},
                      {"scene", s.scene.text ? *s.scene.text : read_file(s.scene.file)}});
}

void ReportRecorder::write(const std::filesystem::path& path, const Simulation& s, const Summary& summary,
                           const PictureScales& scales) const {
    write_file(path, page(s, summary, scales));
}

}  // namespace palpate
