// The text protocol from both ends: replies that a board may send, and lines that the reference sketch may get. The
// first byte chooses.

#include <algorithm>

#include "devices/arduino/palpate_servos/servo_line.h"
#include "devices/drivers/text_protocol.h"

namespace {

const ServoConfig config[] = {{3, 900, 2100, 0}, {5, 1000, 2000, 1500}, {6, 544, 2400, 544}};
ServoBoard board;
int pulse[3];

}  // namespace

void write_pulse(uint8_t channel, uint16_t us) {
    if (channel >= 3 || (us != 0 && (us < config[channel].min_us || us > config[channel].max_us))) __builtin_trap();
    if (us != 0 && board.state == board_idle) __builtin_trap();  // it was never armed
    if (us != 0 && pulse[channel] != 0 && std::abs(us - pulse[channel]) > 1001)
        __builtin_trap();  // 50 ms at 20,000 us/s
    pulse[channel] = us;
}
uint16_t measured_pulse(uint8_t channel) { return uint16_t(pulse[channel]); }
void write_text(const char* text) {
    palpate::text::ReplyReader reader;
    const std::size_t size = strlen(text);
    reader.add({reinterpret_cast<const std::uint8_t*>(text), size});
    if (size > palpate::text::longest_line || !reader.next()) __builtin_trap();  // the driver would not understand it
}

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    if (size < 2) return 0;
    if (data[0] % 2 == 0) {
        palpate::text::ReplyReader reader;
        const std::size_t piece = 1 + data[1] % 64;
        for (std::size_t at = 2; at < size; at += piece) {
            reader.add({data + at, std::min(piece, size - at)});
            while (const auto r = reader.next()) r->value("state"), r->word("3");
        }
        return 0;
    }
    begin_board(board, config, 3, 0);
    std::fill(std::begin(pulse), std::end(pulse), 0);
    std::uint32_t now = 0;
    // Each line gets the checksum that it should have, unless it has one: else none would ever be obeyed.
    std::string line;
    for (std::size_t i = 1; i < size; ++i) {
        const char c = char(data[i]);
        line += c;
        if (c != '\n') continue;
        line.pop_back();
        if (line.size() < 200 && line.find('*') == std::string::npos) {
            char sum[8];
            std::snprintf(sum, sizeof sum, "*%04X", palpate::text::checksum(line));
            line += sum;
        }
        for (const char byte : line + '\n') receive_byte(board, byte, now);
        now += data[i - 1];
        tick_board(board, now);
        line.clear();
    }
    return 0;
}
