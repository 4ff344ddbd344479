#include "scenes/picture/image.h"

#include <zlib.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "meshes/mesh_files.h"
#include "scenes/picture/font.h"

namespace palpate {

Colour skin_colour(double t) {
    // As in viewer/frames.js.
    static constexpr float stops[][3] = {{236, 196, 172}, {244, 143, 98}, {222, 78, 88},
                                         {164, 38, 104},  {98, 18, 104},  {38, 8, 60}};
    constexpr int last = int(std::size(stops)) - 1;
    t = std::clamp(t, 0.0, 1.0) * last;
    const int k = std::min(last - 1, int(t));
    Colour c;
    for (int d = 0; d < 3; ++d)
        c[std::size_t(d)] = (stops[k][d] + float(t - k) * (stops[k + 1][d] - stops[k][d])) / 255;
    return c;
}

Image::Image(int w, int h, Colour colour) : width(w), height(h), rgb(std::size_t(3 * w * h)) {
    fill(0, 0, w, h, colour);
}

void Image::set(int x, int y, Colour colour, double opacity) {
    if (x < 0 || y < 0 || x >= width || y >= height) return;
    std::uint8_t* p = &rgb[std::size_t(3 * (y * width + x))];
    for (std::size_t d = 0; d < 3; ++d)
        p[d] = std::uint8_t(std::lround(std::clamp((1 - opacity) * p[d] + opacity * 255 * colour[d], 0.0, 255.0)));
}

void Image::fill(int x, int y, int w, int h, Colour colour, double opacity) {
    for (int j = y; j < y + h; ++j)
        for (int i = x; i < x + w; ++i) set(i, j, colour, opacity);
}

void Image::frame(int x, int y, int w, int h, Colour colour) {
    fill(x, y, w, 1, colour), fill(x, y + h - 1, w, 1, colour);
    fill(x, y, 1, h, colour), fill(x + w - 1, y, 1, h, colour);
}

int text_width(const std::string& text, int size) { return glyph_width * size * int(text.size()); }

void Image::write(int x, int y, const std::string& text, Colour colour, int size) {
    for (std::size_t k = 0; k < text.size(); ++k) {
        const char c = text[k] >= ' ' && text[k] <= '~' ? text[k] : '?';
        const char* rows = glyph_rows[c - ' '];
        for (int j = 0; j < glyph_height; ++j) {
            const char byte[3] = {rows[2 * j], rows[2 * j + 1], 0};
            const long bits = std::strtol(byte, nullptr, 16);
            for (int i = 0; i < glyph_width; ++i)
                if (bits >> (7 - i) & 1) fill(x + (int(k) * glyph_width + i) * size, y + j * size, size, size, colour);
        }
    }
}

void Image::paste(const Image& other, int x, int y) {
    for (int j = 0; j < other.height; ++j)
        for (int i = 0; i < other.width; ++i) {
            if (x + i < 0 || y + j < 0 || x + i >= width || y + j >= height) continue;
            std::copy_n(&other.rgb[std::size_t(3 * (j * other.width + i))], 3,
                        &rgb[std::size_t(3 * ((y + j) * width + x + i))]);
        }
}

namespace {

void put_word(std::string& out, std::uint32_t v) {
    for (int shift = 24; shift >= 0; shift -= 8) out += char(v >> shift & 255);
}
void put_chunk(std::string& out, const std::string& name, const std::string& data) {
    const std::string body = name + data;
    put_word(out, std::uint32_t(data.size()));
    out += body;
    put_word(out, std::uint32_t(crc32(0, reinterpret_cast<const Bytef*>(body.data()), uInt(body.size()))));
}

}  // namespace

Image fewer_colours(Image image) {
    for (std::uint8_t& v : image.rgb) v = std::uint8_t((v & 0xf8) | v >> 5);
    return image;
}

void write_png(const std::filesystem::path& path, const Image& image) {
    // Each row as its difference from the one above ("up"), which packs smooth pictures well.
    const std::size_t row = std::size_t(3 * image.width);
    std::string raw;
    for (std::size_t y = 0; y < std::size_t(image.height); ++y) {
        raw += char(2);
        for (std::size_t x = 0; x < row; ++x)
            raw += char(image.rgb[y * row + x] - (y > 0 ? image.rgb[(y - 1) * row + x] : 0));
    }
    uLongf size = compressBound(uLong(raw.size()));
    std::string packed(size, '\0');
    compress2(reinterpret_cast<Bytef*>(packed.data()), &size, reinterpret_cast<const Bytef*>(raw.data()),
              uLong(raw.size()), 6);
    packed.resize(size);
    std::string header;
    put_word(header, std::uint32_t(image.width)), put_word(header, std::uint32_t(image.height));
    header += std::string("\x08\x02\x00\x00\x00", 5);  // 8 bits, red green blue
    std::string out = "\x89PNG\r\n\x1a\n";
    put_chunk(out, "IHDR", header);
    put_chunk(out, "IDAT", packed);
    put_chunk(out, "IEND", "");
    write_file(path, out);
}

}  // namespace palpate
