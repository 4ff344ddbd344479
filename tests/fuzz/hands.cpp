// What hand trackers send, as JSON of 26 joints or of a Leap Motion service, and recordings of them. The first byte
// chooses.

#include "meshes/input_error.h"
#include "scenes/trackers/ultraleap.h"
#include "tests/fuzz/temporary_file.h"

using namespace palpate;

namespace {

void read_file(const char* ending, std::span<const std::uint8_t> bytes) {
    try {
        const HandRecording r = read_hand_recording(temporary_file(ending, bytes), "right");
        for (double t : {-1.0, 0.0, 0.5 * r.frames.back().time, 1e9})
            for (int finger = 0; finger < 5; ++finger) sample_recording(r, finger, t);
    } catch (const InputError&) {}
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    if (size < 1) return 0;
    HandMailbox mailbox;
    std::int64_t last_id = -1;
    const char* text = reinterpret_cast<const char*>(data + 1);
    switch (data[0] % 4) {
        case 0:
            take_ultraleap(mailbox, text, size - 1, last_id);
            break;
        case 1:
            take_joints(mailbox, text, size - 1);
            break;
        case 2:
            read_file(".jsonl", {data + 1, size - 1});
            break;
        default:
            read_file(".csv", {data + 1, size - 1});
    }
    const HandCounts counts = mailbox.counts();
    if (counts.malformed > 1 || counts.frames[0] + counts.frames[1] > 2) __builtin_trap();
    mailbox.timing();
    return 0;
}
