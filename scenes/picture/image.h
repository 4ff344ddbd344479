#pragma once
// Pictures as pixels: letters, lines, PNG.

#include <array>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace palpate {

using Colour = std::array<float, 3>;  ///< red, green, blue, 0 to 1

/// From skin over red and purple to nearly black: lightness falls evenly, so that it reads without seeing colours.
Colour skin_colour(double t);

struct Image {
    int width = 0, height = 0;
    std::vector<std::uint8_t> rgb;  ///< [row][column][3], from the top
    Image(int width, int height, Colour colour);
    void set(int x, int y, Colour colour, double opacity = 1);
    void fill(int x, int y, int width, int height, Colour colour, double opacity = 1);
    void frame(int x, int y, int width, int height, Colour colour);
    /// Text from its upper left corner; `size` times as large as the font. Letters beyond ASCII become "?".
    void write(int x, int y, const std::string& text, Colour colour, int size = 1);
    void paste(const Image& other, int x, int y);
};
int text_width(const std::string& text, int size = 1);

/// The same in 5 bits a colour: small files.
Image fewer_colours(Image image);

/// Throws as throw_unwritable (mesh_files.h).
void write_png(const std::filesystem::path& path, const Image& image);

}  // namespace palpate
