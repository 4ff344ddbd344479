// What a Maestro would be sent, as lines of a file.

#include <chrono>
#include <cmath>
#include <cstdio>

#include "devices/drivers/maestro.h"
#include "devices/drivers/maestro_protocol.h"
#include "devices/loop/clock.h"
#include "meshes/plain_numbers.h"

namespace palpate::maestro {

namespace {

class DryLink final : public BoardLink {
  public:
    DryLink(LinkSettings settings, const std::filesystem::path& log)
        : settings_(std::move(settings)), log_(nullptr, &std::fclose), path_(log) {
        std::error_code problem;
        if (log.has_parent_path()) std::filesystem::create_directories(log.parent_path(), problem);
        log_.reset(std::fopen(log.c_str(), "w"));
    }

    std::string open(std::span<WireValue>) override {
        if (!log_) return path_.string() + ": cannot be written";
        std::fputs("time_s,bmRequestType,bRequest,wValue,wIndex\n", log_.get());
        limit_speed(first_move_share);
        line(clear_errors());
        return "";
    }
    void close() override {
        if (log_) std::fflush(log_.get());
    }
    LinkProblem write(std::span<const ChannelTarget> targets, std::span<Transfer> transfers) override {
        for (std::size_t i = 0; i < targets.size(); ++i) {
            line(set_target(targets[i].channel, targets[i].value));
            transfers[i] = {device_clock(), device_clock()};
        }
        return {};
    }
    LinkProblem feed() override {
        line(clear_errors());
        return {};
    }
    LinkProblem limit_speed(double share) override {
        for (const auto& [channel, limits] : settings_.limits)
            line(set_speed(channel, std::uint16_t(std::ceil(share * limits.speed / 25))));
        return {};
    }

  private:
    void line(const Request& r) {
        const PlainNumbers plain;
        const double t = std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
        std::fprintf(log_.get(), "%.4f,0x%02x,0x%02x,%u,%u\n", t, r.type, r.request, r.value, r.index);
    }
    LinkSettings settings_;
    std::unique_ptr<FILE, int (*)(FILE*)> log_;
    std::filesystem::path path_;
    std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

}  // namespace

std::unique_ptr<BoardLink> make_dry_link(const LinkSettings& settings, const std::filesystem::path& log) {
    return std::make_unique<DryLink>(settings, log);
}

}  // namespace palpate::maestro
