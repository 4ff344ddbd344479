#include "scenes/recording/outputs.h"

#include <algorithm>
#include <array>
#include <filesystem>
#include <fstream>
#include <string_view>

#include "meshes/input_error.h"

namespace palpate {

namespace {

using namespace std::string_view_literals;

bool begins_like(Output kind, const std::filesystem::path& path, std::string_view head) {
    switch (kind) {
        case Output::recording:
            return head.starts_with("palpate");
        case Output::report:
            return (head.starts_with("<!DOCTYPE html>") || head.starts_with("<!doctype html>"));
        case Output::hdf5:
            return head.starts_with("\x89HDF\r\n"sv);
        case Output::film:
            return head.starts_with("GIF8") || head.starts_with("\x1a\x45\xdf\xa3"sv) ||
                   (head.size() >= 8 && head.substr(4, 4) == "ftyp") || head.starts_with("RIFF");
        case Output::frames:
            return head.starts_with("{");
        case Output::scene:
            return path.extension() == ".toml";
    }
    return false;
}

constexpr std::array output_names{
    "recording", "report", "film", "HDF5 file", "scene file (.toml)", "recording of hands (.jsonl)"};

}  // namespace

void refuse_to_replace(const std::string& option, const std::string& file, Output kind) {
    std::error_code none;
    // Hands are written while they come: a pipe that nobody reads would be waited for.
    if (kind == Output::frames && !file.empty() && std::filesystem::is_fifo(file, none))
        throw InputError(option + " " + file + ": is a pipe; give the name of a file");
    if (file.empty() || !std::filesystem::is_regular_file(file, none)) return;
    std::array<char, 16> bytes{};
    std::ifstream in(file, std::ios::binary);
    in.read(bytes.data(), bytes.size());
    const std::string_view head(bytes.data(), std::size_t(in.gcount()));
    if (head.empty() || begins_like(kind, file, head)) return;
    throw InputError(option + " " + file + ": exists, and is no " + output_names[std::size_t(kind)] +
                     ": it would be lost; give another name, or remove it first");
}

}  // namespace palpate
