#pragma once
// A file in memory that holds what a fuzzer made up.

#include <unistd.h>

#include <cstdint>
#include <cstdio>
#include <span>
#include <string>

/// Writes it to a path of this process's own, and returns the path.
inline std::string temporary_file(const std::string& ending, std::span<const std::uint8_t> bytes) {
    const std::string path = "/dev/shm/palpate_fuzz_" + std::to_string(getpid()) + ending;
    std::FILE* f = std::fopen(path.c_str(), "wb");
    if (!f || std::fwrite(bytes.data(), 1, bytes.size(), f) != bytes.size() || std::fclose(f) != 0) __builtin_trap();
    return path;
}
