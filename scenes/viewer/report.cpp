#include "scenes/viewer/report.h"

#include <cstdio>
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
    append_frame(frames_, s, rendered_pads_->solve(s), *hands_, since_);
    ++count_;
    since_ = {};
    next_ += 1 / rate_;  // from when it was due: steps that do not divide the period lower no rate
    if (next_ <= s.world.time) next_ = s.world.time + 1 / rate_;
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
                   "%.3g s in steps of %.3g ms, %.1f %% of them converged; %d frames shown (at most %.0f per second)",
                   s.world.time, 1e3 * s.world.solver.dt, 100 * converged, count_, rate_);
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
