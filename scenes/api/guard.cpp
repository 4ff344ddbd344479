#include "scenes/api/guard.h"

#include <atomic>
#include <cstdio>
#include <filesystem>
#include <mutex>
#include <new>
#include <stdexcept>
#include <vector>

#include "meshes/input_error.h"
#include "scenes/api/session.h"

namespace palpate::api {

namespace {

thread_local char message[4096] = "";

/// A world's place. `word`: generation (odd: alive) in the upper half, threads inside in the lower one.
struct Slot {
    std::atomic<std::uint64_t> word{0};
    std::unique_ptr<Session> session;
};
constexpr std::int64_t slot_count = 65536;
/// Never freed, as free_slots.
Slot* slots() {
    static Slot* all = new Slot[slot_count];
    return all;
}
std::mutex creation;
std::int64_t used_slots = 0;

/// Slots of destroyed worlds; never freed, so that worlds may be destroyed while the program ends.
std::vector<std::int64_t>& free_slots() {
    static auto* list = new std::vector<std::int64_t>;
    return *list;
}

constexpr std::uint32_t last_generation = 0x7ffffffd;
std::uint32_t generation_of(std::uint64_t word) { return std::uint32_t(word >> 32); }

}  // namespace

std::int32_t fail(std::int32_t code, const char* text) noexcept {
    std::snprintf(message, sizeof message, "%s", text);
    return code;
}
std::int32_t fail(std::int32_t code, const std::string& text) noexcept { return fail(code, text.c_str()); }

const char* last_message() noexcept { return message; }

std::int32_t fail_of_exception() noexcept {
    try {
        throw;
    } catch (const InputError& error) {
        return fail(PALPATE_ERROR_SCENE, error.what());
    } catch (const std::bad_alloc&) {
        return fail(PALPATE_ERROR_MEMORY, "out of memory: fewer worlds, fingers or elements need less");
    } catch (const std::length_error&) {
        return fail(PALPATE_ERROR_MEMORY, "out of memory: fewer worlds, fingers or elements need less");
    } catch (const std::filesystem::filesystem_error& error) {
        return fail(PALPATE_ERROR_FILE, error.what());
    } catch (const std::invalid_argument& error) {
        return fail(PALPATE_ERROR_SCENE, error.what());
    } catch (const std::exception& error) { return fail(PALPATE_ERROR_INTERNAL, error.what()); } catch (...) {
        return fail(PALPATE_ERROR_INTERNAL, "a fault in palpate");
    }
}

PalpateWorld adopt(std::unique_ptr<Session> session) {
    const std::lock_guard lock(creation);
    auto& free = free_slots();
    std::int64_t at = -1;
    if (!free.empty()) {
        at = free.back();
        free.pop_back();
    } else if (used_slots < slot_count) {
        at = used_slots++;
    } else {
        throw std::bad_alloc();
    }
    Slot& slot = slots()[at];
    slot.session = std::move(session);
    const std::uint64_t generation = generation_of(slot.word.load()) + 1;
    const PalpateWorld id = std::int64_t(generation << 32) | (at + 1);
    slot.session->id = id;
    slot.word.store(generation << 32, std::memory_order_release);
    return id;
}

namespace {

/// The slot that an id names, if that can be.
std::int64_t slot_of(PalpateWorld world, std::uint32_t& generation) {
    generation = std::uint32_t(std::uint64_t(world) >> 32);
    const auto at = std::int64_t(std::uint64_t(world) & 0xffffffffu) - 1;
    return world > 0 && generation % 2 == 1 && at >= 0 && at < slot_count ? at : -1;
}

}  // namespace

std::int32_t fail_no_world(PalpateWorld world) noexcept {
    return fail(PALPATE_ERROR_WORLD, world == 0 ? "world 0 is none: make one with palpate_load, palpate_load_text or "
                                                  "palpate_build"
                                                : "there is no such world, or it has been destroyed");
}

std::int32_t discard(PalpateWorld world) {
    std::uint32_t generation = 0;
    const std::int64_t at = slot_of(world, generation);
    if (at < 0) return fail_no_world(world);
    Slot& slot = slots()[at];
    std::uint64_t alone = std::uint64_t(generation) << 32;
    if (!slot.word.compare_exchange_strong(alone, std::uint64_t(generation + 1) << 32)) {
        if (generation_of(alone) != generation) return fail_no_world(world);
        return fail(PALPATE_ERROR_BUSY, "another thread is using the world: destroy it when that is done");
    }
    slot.session.reset();
    const std::lock_guard lock(creation);
    if (generation < last_generation) free_slots().push_back(at);
    return PALPATE_OK;
}

Use::Use(PalpateWorld world) {
    std::uint32_t generation = 0;
    const std::int64_t at = slot_of(world, generation);
    if (at < 0) return;
    Slot& slot = slots()[at];
    std::uint64_t word = slot.word.load(std::memory_order_relaxed);
    do {
        if (generation_of(word) != generation) return;
    } while (!slot.word.compare_exchange_weak(word, word + 1, std::memory_order_acquire));
    slot_ = at;
    session_ = slot.session.get();
}

Use::~Use() {
    if (slot_ >= 0) slots()[slot_].word.fetch_sub(1, std::memory_order_release);
}

bool alone_in(PalpateWorld world) {
    std::uint32_t generation = 0;
    const std::int64_t at = slot_of(world, generation);
    return at >= 0 && slots()[at].word.fetch_add(0, std::memory_order_acq_rel) == (std::uint64_t(generation) << 32) + 1;
}

Owner::Owner(PalpateWorld world) : use_(world) {
    if (!use_)
        result_ = fail_no_world(world);
    else if (use_->owned.test_and_set(std::memory_order_acquire))
        result_ = fail(PALPATE_ERROR_BUSY,
                       "the world is being stepped or read by another thread, or stands in the "
                       "list twice: one owner at a time");
}

Owner::~Owner() {
    if (use_ && result_ == PALPATE_OK) use_->owned.clear(std::memory_order_release);
}

}  // namespace palpate::api

extern "C" const char* palpate_last_error(void) { return palpate::api::last_message(); }
