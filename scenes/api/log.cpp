// What a person should know, told to the host: about scenes as they are loaded, and steps that went wrong.

#include <mutex>

#include "meshes/plain_numbers.h"
#include "scenes/api/guard.h"
#include "scenes/api/session.h"

namespace palpate::api {

namespace {

std::mutex lock;
PalpateLog hook = nullptr;
void* hook_user = nullptr;
std::atomic<bool> hooked{false};  ///< so that steps without a log look at nothing else

/// What this thread's log is being told.
thread_local std::int32_t told_level = PALPATE_LOG_NOTE;
thread_local PalpateWorld told_world = 0;
thread_local bool telling = false;

}  // namespace

void log(std::int32_t level, PalpateWorld world, const char* message) {
    PalpateLog now;
    void* user;
    {
        const std::lock_guard guard(lock);
        now = hook, user = hook_user;
    }
    if (!now) return;
    told_level = level, told_world = world, telling = true;
    now(message, user);
    telling = false;
}

void log_scene(const Scene& scene) {
    for (const auto& w : scene.warnings) log(PALPATE_LOG_WARNING, 0, w.c_str());
    for (const auto& n : scene.notes) log(PALPATE_LOG_NOTE, 0, n.c_str());
}

void log_step(Session& s) {
    if (!hooked.load(std::memory_order_relaxed)) return;
    const World& w = s.world();
    s.unconverged.resize(w.skins.size());
    for (std::size_t i = 0; i < w.skins.size(); ++i) {
        const SkinStatus& status = skin_status(w, s.simulation->fingers[i]);
        const char* name = w.skins[i].name.c_str();
        const auto step = static_cast<long long>(w.step);
        char text[400];
        if (status.reset) {
            plain_snprintf(text, sizeof text,
                           "%.100s diverged in step %lld and was put back to rest: smaller steps (dt_ms), or slower "
                           "poses, hold it",
                           name, step);
            log(PALPATE_LOG_WARNING, s.id, text);
        }
        if (status.converged) continue;
        const std::int64_t n = ++s.unconverged[i];
        if ((n & (n - 1)) != 0) continue;
        plain_snprintf(
            text, sizeof text,
            "%.100s: step %lld did not converge (%lld of its steps so far): %.2g N out of balance, limits exceeded by "
            "%.2g, %.2g um inside an object%s; more iterations (solver.newton_iterations), a preset that has them, "
            "or smaller steps (dt_ms) help",
            name, step, static_cast<long long>(n), status.residual_N, status.limit_violation,
            1e6 * status.penetration_m, status.wrong_sides ? ", through the skin" : "");
        log(PALPATE_LOG_WARNING, s.id, text);
    }
}

}  // namespace palpate::api

using namespace palpate::api;

int32_t palpate_set_log(PalpateLog log, void* user) {
    return guarded([&] {
        const std::lock_guard guard(lock);
        hook = log, hook_user = user;
        hooked = log != nullptr;
        return PALPATE_OK;
    });
}

int32_t palpate_log_about(int32_t* level, PalpateWorld* world) {
    if (!telling) return fail(PALPATE_ERROR_STATE, "palpate_log_about is for a PalpateLog, while it is being called");
    if (level) *level = told_level;
    if (world) *world = told_world;
    return PALPATE_OK;
}
