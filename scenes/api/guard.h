#pragma once
// Ids of worlds, errors, and the border that no exception crosses.

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>

#include "scenes/api/palpate.h"

namespace palpate::api {

struct Session;

/// Keeps the message for palpate_last_error, cut where it is too long; returns the code.
std::int32_t fail(std::int32_t code, const std::string& message) noexcept;
/// The same without memory to fail for.
std::int32_t fail(std::int32_t code, const char* message) noexcept;
const char* last_message() noexcept;
/// Code and message of the exception that is being handled.
std::int32_t fail_of_exception() noexcept;

/// Runs what may throw.
template <class Work>
std::int32_t guarded(Work work) noexcept {
    try {
        return work();
    } catch (...) { return fail_of_exception(); }
}

/// Puts a session under a fresh id.
PalpateWorld adopt(std::unique_ptr<Session> session);
/// Frees it, unless a thread is using it.
std::int32_t discard(PalpateWorld world);

/// Holds a session for the time of a call, so that nobody destroys it meanwhile. Empty where there is no such world.
class Use {
  public:
    explicit Use(PalpateWorld world);
    ~Use();
    Use(const Use&) = delete;
    Use& operator=(const Use&) = delete;
    explicit operator bool() const { return session_ != nullptr; }
    Session* operator->() const { return session_; }
    Session& operator*() const { return *session_; }

  private:
    std::int64_t slot_ = -1;
    Session* session_ = nullptr;
};
/// Within a call of the world's owner: whether no other thread is in a call of it. What those find from now on they
/// find as it is now.
bool alone_in(PalpateWorld world);
std::int32_t fail_no_world(PalpateWorld world) noexcept;

/// The same as the one thread that steps, reads views, saves. Not sole where another one is.
class Owner {
  public:
    explicit Owner(PalpateWorld world);
    ~Owner();
    Owner(const Owner&) = delete;
    Owner& operator=(const Owner&) = delete;
    /// PALPATE_OK, or why not.
    std::int32_t result() const { return result_; }
    Session* operator->() const { return &*use_; }
    Session& operator*() const { return *use_; }

  private:
    Use use_;
    std::int32_t result_ = PALPATE_OK;
};

/// Reads a caller's struct of any version: what it lacks keeps its default. False where its size cannot be one.
template <class Struct>
bool read_struct(const Struct* given, Struct& own) {
    own.size = std::int32_t(sizeof own);
    if (!given) return true;
    const std::int32_t size = given->size;
    if (size < std::int32_t(2 * sizeof(std::int32_t)) || size > 65536) return false;
    __builtin_memcpy(&own, given, size < std::int32_t(sizeof own) ? std::size_t(size) : sizeof own);
    own.size = std::int32_t(sizeof own);
    return true;
}
/// Writes as much as the caller's struct has room for. False where its size cannot be one.
template <class Struct>
bool write_struct(const Struct& own, Struct* out) {
    const std::int32_t size = out->size;
    if (size < std::int32_t(2 * sizeof(std::int32_t)) || size > 65536) return false;
    __builtin_memcpy(out, &own, size < std::int32_t(sizeof own) ? std::size_t(size) : sizeof own);
    out->size = size;
    return true;
}
inline constexpr char wrong_size[] = "the struct's `size` is not set: write sizeof of it there before the call";

}  // namespace palpate::api
