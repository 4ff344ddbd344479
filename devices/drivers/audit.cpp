#include "devices/drivers/audit.h"

#include <algorithm>
#include <cstdio>
#include <memory>

#include "meshes/plain_numbers.h"

namespace palpate {

const char* name(BoardState state) {
    static constexpr const char* names[] = {"unconfigured", "inactive", "active", "faulted"};
    return names[int(state)];
}

bool Audit::write(const std::filesystem::path& file, const std::vector<BoardTransition>& transitions,
                  double now) const {
    std::error_code ignored;
    if (file.has_parent_path()) std::filesystem::create_directories(file.parent_path(), ignored);
    const std::filesystem::path part = file.string() + ".part";
    std::unique_ptr<FILE, int (*)(FILE*)> out(std::fopen(part.c_str(), "w"), &std::fclose);
    if (!out) return false;
    const PlainNumbers plain;
    for (const BoardTransition& t : transitions)
        std::fprintf(out.get(), "# %.4f %s to %s: %s\n", t.at - now, name(t.from), name(t.to), t.reason.c_str());
    std::fputs("time_s,channel,what,value,arrived,age_ms\n", out.get());
    for (std::size_t i = next_ - std::min(next_, capacity); i < next_; ++i) {
        const SentValue& v = ring_[i % capacity];
        std::fprintf(out.get(), "%.4f,%d,%s,%u,%d,", v.at - now, v.channel, v.torque ? "torque" : "target", v.value,
                     v.arrived);
        v.age >= 0 ? std::fprintf(out.get(), "%.2f\n", 1e3 * double(v.age)) : std::fputs("\n", out.get());
    }
    bool whole = std::ferror(out.get()) == 0;
    whole &= std::fclose(out.release()) == 0;
    if (whole) std::filesystem::rename(part, file, ignored);
    if (whole && !ignored) return true;
    std::filesystem::remove(part, ignored);
    return false;
}

}  // namespace palpate
