// `palpate tracker`: what a hand tracker or a recording gives, how well, and how its fingers fit the model's.
// `palpate emulate-tracker`: a recording, served as a Leap Motion service would.

#include <cmath>
#include <cstdio>
#include <fstream>
#include <thread>

#include "meshes/finger_shape.h"
#include "meshes/input_error.h"
#include "scenes/load/scene.h"
#include "scenes/program/commands.h"
#include "scenes/recording/outputs.h"
#include "scenes/trackers/hand_doubts.h"
#include "scenes/trackers/hand_source.h"
#include "scenes/trackers/pinch_fit.h"
#include "scenes/trackers/recorded_time.h"
#include "scenes/trackers/ultraleap.h"

namespace palpate {

namespace {

struct TrackerArguments {
    std::string source, hand = "right", record, scene;
    std::vector<std::string> pinch;
    double seconds = 0, thickness_mm = 0;
    bool any_address = false;
};

bool is_file(const std::string& source) {
    return source.ends_with(".csv") || source.ends_with(".jsonl") || source.ends_with(".json");
}

/// Frames of both hands as they came; a hand without frames stays empty.
using Hands = std::array<HandRecording, 2>;

void describe_bones(const BoneTally& bones) {
    if (bones.frames() == 0) return;
    const std::string problem = bone_problem(bones);
    if (problem.empty())
        std::printf(
            "  rotations agree with positions: distal bones point less than %.0f degrees beside their tips "
            "(median)\n",
            2 + bones.median(BoneReading::meant));
    else
        std::printf("  %s\n", problem.c_str());
}

void describe(const Hands& hands) {
    for (std::size_t side : {1u, 0u}) {
        const auto& frames = hands[side].frames;
        if (frames.size() < 2) continue;
        std::vector<double> intervals;
        int unseen = 0, jumps = 0, flips = 0;
        for (std::size_t k = 0; k < frames.size(); ++k) {
            unseen += !frames[k].valid;
            if (k == 0) continue;
            intervals.push_back(1e3 * (frames[k].time - frames[k - 1].time));
            if (!frames[k].valid || !frames[k - 1].valid) continue;
            for (std::size_t f = 0; f < 5; ++f) {
                const Pose<double>&a = frames[k - 1].finger[f], &b = frames[k].finger[f];
                jumps += norm(b.position - a.position) > 0.05;
                flips += norm(shorter_twice_vector(b.rotation * conjugate(a.rotation))) > 1.5;
            }
        }
        std::sort(intervals.begin(), intervals.end());
        std::printf("%s hand: %zu frames in %.2f s, every %.1f ms (95 %% within %.1f, longest %.0f)", hand_names[side],
                    frames.size(), frames.back().time - frames.front().time, intervals[intervals.size() / 2],
                    intervals[std::size_t(0.95 * double(intervals.size() - 1))], intervals.back());
        std::printf("; unseen in %d, jumps of a finger by 50 mm %d, flips %d\n", unseen, jumps, flips);
        if (!hands[side].note.empty()) std::printf("  %s\n", hands[side].note.c_str());
        if (const std::string problem = recorded_time_problem(hands[side]); !problem.empty())
            std::printf("  %s\n", problem.c_str());
        describe_bones(bones_of(hands[side]));
    }
}

/// The meshes of the fingers that are fitted: the scene's that follow them, or the median ones.
std::array<TetMesh, 2> pads_of(const TrackerArguments& a, const std::array<int, 2>& fingers) {
    std::array<TetMesh, 2> pads;
    std::optional<Scene> scene;
    if (!a.scene.empty()) scene = load_scene(a.scene);
    for (std::size_t k : {0u, 1u}) {
        const std::string name = finger_names[std::size_t(fingers[k])];
        FingerTemplates templates;
        FingerModel model;
        model.mesh.shape = finger_shape(name);
        std::string note;
        if (!scene) {
            pads[k] = build_finger(model, templates, note).mesh;
            continue;
        }
        const auto& motions = scene->finger_motions;
        const auto it = std::find_if(motions.begin(), motions.end(), [&](const FingerMotion& m) {
            return m.followed_finger == fingers[k] && hand_names[std::size_t(m.hand)] == a.hand;
        });
        if (it == motions.end()) throw InputError(a.scene + ": no finger follows the " + a.hand + " " + name);
        pads[k] = scene->spec.fingers[std::size_t(it - motions.begin())].mesh;
    }
    return pads;
}

void print_fit(const TrackerArguments& a, const Hands& hands) {
    std::array<int, 2> fingers{};
    if (a.pinch.size() != 2) throw InputError("--pinch: expected two fingers, for example thumb,index");
    for (std::size_t k : {0u, 1u}) {
        const auto it = std::find(finger_names.begin(), finger_names.end(), a.pinch[k]);
        if (it == finger_names.end())
            throw InputError("--pinch: expected thumb, index, middle, ring or little, found \"" + a.pinch[k] + "\"");
        fingers[k] = int(it - finger_names.begin());
    }
    const auto pads = pads_of(a, fingers);
    const PinchFit p = fit_pinch(hands[a.hand == "right"], fingers, {&pads[0], &pads[1]}, 1e-3 * a.thickness_mm);
    std::printf("\n%s and %s pinch from %.2f to %.2f s (%d frames), tips %.1f mm apart\n", a.pinch[0].c_str(),
                a.pinch[1].c_str(), p.start, p.end, p.frames, 1e3 * p.gap);
    for (std::size_t k : {0u, 1u}) {
        const Vec3<double>&x = p.fit[k].position, &d = p.direction[k];
        const double roll = 2 * std::atan2(p.fit[k].rotation.x, p.fit[k].rotation.w) * 180 / M_PI;
        std::printf("# %s: the other one is %.0f %% distal, %.0f %% across\n", a.pinch[k].c_str(), 100 * d.x,
                    100 * std::hypot(d.y, d.z));
        std::printf("[finger.%s] fit = { position_mm = [%.2f, %.2f, %.2f], rotation_deg = [%.1f, 0, 0] }\n",
                    a.pinch[k].c_str(), 1e3 * x.x, 1e3 * x.y, 1e3 * x.z, roll);
    }
    std::printf("# so that they meet at the scene's origin:\nposition_mm = [%.2f, %.2f, %.2f]\n", -1e3 * p.place.x,
                -1e3 * p.place.y, -1e3 * p.place.z);
}

/// Frames as they come from a live source, kept and written down.
struct Keeper {
    std::mutex mutex;
    Hands hands;
    RecordedTime times;
    std::string path;  ///< of the file; empty: none
    std::ofstream file;
    std::chrono::steady_clock::time_point start = std::chrono::steady_clock::now();
    void keep(int hand, HandFrame frame) {
        const std::lock_guard lock(mutex);
        const auto arrival = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
        frame.time = times.of(hand, arrival, frame.own_time);
        if (!file.is_open() && !path.empty()) {  // no frame, no file: one that is there is not lost to nothing
            file.open(path);
            file << hand_header() << "\n";
            if (!file) path.clear();
        }
        if (file.is_open()) file << hand_line(hand, frame) << std::endl;  // flushed: nothing is lost when killed
        auto& frames = hands[std::size_t(hand)].frames;
        if (frames.size() < 1'000'000) frames.push_back(frame);
    }
};

void watch(const TrackerArguments& a, Hands& hands, const std::atomic<bool>& stop) {
    Keeper keeper;
    if (!a.record.empty()) {
        refuse_to_replace("--record", a.record, Output::frames);
        keeper.path = a.record;
        if (!std::ofstream(a.record, std::ios::app)) throw InputError(a.record + ": cannot be written");
    }
    {
        LiveHands live(a.source, a.any_address, [&](int hand, const HandFrame& f) { keeper.keep(hand, f); });
        std::printf("%s%s\n", live.source->about().c_str(), a.seconds > 0 ? "" : "   (Ctrl-C ends)");
        std::fflush(stdout);
        DoubtTeller doubts;
        for (int k = 1; !stop && (a.seconds <= 0 || k <= int(std::ceil(10 * a.seconds))); ++k) {
            std::this_thread::sleep_for(std::chrono::milliseconds(100));
            if (k % 10) continue;
            const HandTiming t = live.mailbox.timing();
            std::string seen, still;
            for (int hand : {1, 0}) {
                const std::string name = std::string(" ") + hand_names[std::size_t(hand)];
                if (live.mailbox.newest(hand, 1).valid) seen += name;
                if (live.mailbox.stands_still(hand)) still += name;
            }
            std::printf("%5.1f Hz, every %.1f ms (95 %% within %.1f)", t.rate_Hz, t.interval_ms, t.interval_p95_ms);
            if (t.has_clock)
                std::printf(", behind the fastest frame by %.1f ms (95 %% within %.1f)", t.delay_ms, t.delay_p95_ms);
            std::printf(";%s", seen.empty() ? " no hand is seen" : seen.c_str());
            std::printf("%s%s\n", still.empty() ? "" : "; time stands still:", still.c_str());
            for (const std::string& text : doubts.news(live.mailbox)) std::printf("  %s\n", text.c_str());
            std::fflush(stdout);
        }
        std::printf("%s\n", to_text(live.mailbox.counts()).c_str());
        for (const HandDoubt& doubt : hand_doubts(live.mailbox))  // of rotations the description tells
            if (doubt.key != std::string("bones")) std::printf("  %s\n", doubt.text.c_str());
    }
    hands = std::move(keeper.hands);
}

int show_tracker(const TrackerArguments& a, const std::atomic<bool>& stop) {
    Hands hands;
    if (is_file(a.source)) {
        std::string problems;
        for (std::size_t side : {0u, 1u}) try {
                hands[side] = read_hand_recording(a.source, hand_names[side]);
            } catch (const InputError& error) {
                if (hand_names[side] == a.hand) throw;
            }
    } else {
        if (const std::string wrong = tracker_problem(a.source); !wrong.empty())
            throw InputError("tracker: " + wrong + " (or a recording, .csv or .jsonl)");
        watch(a, hands, stop);
    }
    describe(hands);
    if (!a.pinch.empty()) print_fit(a, hands);
    return 0;
}

struct EmulatorArguments {
    std::string file;
    int port = ultraleap_port;
    double speed = 1;
    bool loop = false;
};

int emulate(const EmulatorArguments& a, const std::atomic<bool>& stop) {
    std::array<std::shared_ptr<const HandRecording>, 2> hands;
    std::string problem;
    for (std::size_t side : {0u, 1u}) try {
            hands[side] = std::make_shared<HandRecording>(read_hand_recording(a.file, hand_names[side]));
        } catch (const InputError& error) { problem = error.messages.front(); }
    if (!hands[0] && !hands[1]) throw InputError(problem);
    UltraleapEmulator emulator(a.port, hands, a.speed, a.loop);
    std::printf("serving %s at ws://127.0.0.1:%d/v6.json from the first client on   (Ctrl-C ends)\n", a.file.c_str(),
                emulator.port());
    std::fflush(stdout);
    while (!stop && !emulator.ended()) std::this_thread::sleep_for(std::chrono::milliseconds(20));
    return 0;
}

}  // namespace

Action add_tracker_command(const Command& program, const std::atomic<bool>& stop) {
    const Command c =
        program.subcommand("tracker", "show what a hand tracker or a recording gives; fit it to the model");
    auto a = std::make_shared<TrackerArguments>();
    c.option("source", a->source,
             "udp:PORT, websocket:PORT, openxr, ultraleap[:HOST:PORT], or a recording (.jsonl, .csv)")
        .required();
    c.option("--seconds", a->seconds, "how long to watch a live source (default: until Ctrl-C)").range(0.1, 1e5);
    c.option("--record", a->record, "write the frames of a live source to this file (.jsonl)");
    c.option("--pinch", a->pinch, "fit two fingers by the moment in which they touch: thumb,index").comma_separated();
    c.option("--thickness-mm", a->thickness_mm, "of what the fitted fingers hold when the tracked ones touch")
        .range(0.0, 200.0);
    c.option("--hand", a->hand, "which hand is fitted (default: right)").among({"left", "right"});
    c.scene("--scene", a->scene, "fit the fingers of this scene (default: median thumb, index, ...)");
    c.flag("--any-address", a->any_address,
           "take hands from other machines, too; a WebSocket asks for the token (default: this one only)");
    return [a, &stop] { return show_tracker(*a, stop); };
}

Action add_emulate_tracker_command(const Command& program, const std::atomic<bool>& stop) {
    const Command c = program.subcommand("emulate-tracker", "serve a recorded hand as a Leap Motion service would");
    auto a = std::make_shared<EmulatorArguments>();
    c.option("file", a->file, "recording (.jsonl, .csv)").required();
    c.option("--port", a->port, "port (default: 6437; 0 = any free one)").range(0, 65535);
    c.option("--speed", a->speed, "recorded seconds per second").range(1e-3, 1e3);
    c.flag("--loop", a->loop, "again and again");
    return [a, &stop] { return emulate(*a, stop); };
}

}  // namespace palpate
