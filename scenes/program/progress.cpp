#include "scenes/program/progress.h"

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace palpate {

namespace {

std::string duration(double s) {
    char text[32];
    if (s < 99.5)
        std::snprintf(text, sizeof text, "%.0f s", std::max(0.0, s));
    else if (s < 99.5 * 60)
        std::snprintf(text, sizeof text, "%.0f min", s / 60);
    else
        std::snprintf(text, sizeof text, "%.1f h", std::min(s, 1e9) / 3600);
    return text;
}

}  // namespace

std::string progress_line(const std::string& what, double share, double elapsed_s, std::int64_t steps,
                          double simulated_s) {
    share = std::clamp(share, 0.0, 1.0);
    std::string bar(std::size_t(std::lround(20 * share)), '#');
    bar.resize(20, '.');
    char text[200];
    std::snprintf(text, sizeof text, "%.18s [%s] %3.0f %%", what.c_str(), bar.c_str(), 100 * share);
    std::string line = text;
    if (simulated_s > 0 && elapsed_s > 0) {
        std::snprintf(text, sizeof text, "  %.0f steps/s, %.2g x real time", double(steps) / elapsed_s,
                      simulated_s / elapsed_s);
        line += text;
    }
    if (share > 0.005) line += "  " + duration(elapsed_s * (1 - share) / share) + " left";
    return line.substr(0, 79);
}

Progress::Progress(std::string what, bool quiet)
    : what_(std::move(what)),
      on_(!quiet && isatty(STDERR_FILENO) != 0),
      begun_(Clock::now()),
      next_(begun_ + std::chrono::seconds(1)) {}

void Progress::show(double share, std::int64_t steps, double simulated_s) {
    if (!on_) return;
    const auto now = Clock::now();
    if (now < next_) return;
    next_ = now + std::chrono::milliseconds(100);
    const double elapsed = std::chrono::duration<double>(now - begun_).count();
    std::fprintf(stderr, "\r%-79s", progress_line(what_, share, elapsed, steps, simulated_s).c_str());
    std::fflush(stderr);
    shown_ = true;
}

void Progress::clear() {
    if (shown_) std::fprintf(stderr, "\r%79s\r", ""), std::fflush(stderr);
    shown_ = false;
}

}  // namespace palpate
