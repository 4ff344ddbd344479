// The viewer: frames, report, the live server with good and bad clients, and the page in a real browser where one is
// installed (Debian package chromium).

#include <arpa/inet.h>
#include <civetweb.h>
#include <signal.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <condition_variable>
#include <cstring>
#include <fstream>
#include <map>
#include <mutex>
#include <nlohmann/json.hpp>
#include <sstream>

#include "engine/contact/contact_edge.h"
#include "meshes/input_error.h"
#include "scenes/load/presets.h"
#include "scenes/picture/scene_triangles.h"
#include "scenes/recording/run_file.h"
#include "scenes/viewer/report.h"
#include "scenes/viewer/server.h"
#include "tests/real_time.h"
#include "tests/scenes/browser.h"
#include "tests/support.h"

namespace palpate {
namespace {

using testing::attribute, testing::browser_is_installed, testing::column_by_ms, testing::page_of,
    testing::what_a_browser_says;

using testing::scenes;

float float_at(const std::vector<std::uint8_t>& bytes, std::size_t at) {
    float v;
    std::memcpy(&v, &bytes[at], sizeof v);
    return v;
}

TEST(Stage, AFrameHoldsWhatTheWorldHolds) {
    Simulation s = make_simulation(load_scene(scenes + "press.toml"), 1);
    while (s.world.contact_surfaces[0].normal_force < 0.3) advance(s);
    for (int k = 0; k < 40; ++k) advance(s);  // the thimble has followed
    const nlohmann::json model = page_model(s);
    std::vector<std::uint8_t> frame;
    RenderedPads pads(s);
    const std::vector<RenderedPad>& felt = pads.solve(s);
    DrawnHands hands(s);
    SinceFrame since;
    for (int k = 0; k < 3; ++k) note_step(since, s);
    EXPECT_EQ(since.converged, std::vector<int>{skin_status(s.world, s.fingers[0]).converged ? 3 : 0});
    since.longest_us = 123, since.converged = {2};
    append_frame(frame, s, felt, hands, since);
    const auto& finger = model["fingers"][0];
    const std::size_t nodes = finger["rest"].size() / 3, samples = finger["samples"].size();
    const std::size_t joints = model["thimbles"][0]["joint_min"].size();
    constexpr std::size_t hand_bytes = hand_bone_count * (9 * 2 + 3 * 4);
    ASSERT_EQ(model["hands"].size(), 1u);
    const std::size_t outline = contact_outline(s.world.contact_surfaces[0]).size();
    EXPECT_GT(outline, 10u);
    EXPECT_EQ(frame.size(), 12 + 48 + 10 * nodes + 6 * samples + 2 + 6 * outline + 28 * model["objects"].size() + 28 +
                                4 * joints + 8 + 6 * (4 + 4 + 3 * 3) +  // two frames, three legs
                                8 + 8 * nodes + samples +               // the pad on the platform
                                hand_bytes);
    // The platform presses about as hard as the table, and touches about the same samples.
    EXPECT_NEAR(felt[0].normal_force, s.world.contact_surfaces[0].normal_force, 0.1);
    int both = 0, either = 0;
    for (std::size_t k = 0; k < samples; ++k) {
        const int bits = frame[frame.size() - hand_bytes - samples + k];
        EXPECT_EQ(bits & 1, int(s.world.contact_surfaces[0].touches[k]));
        both += bits == 3, either += bits != 0;
    }
    EXPECT_GT(both, 3);
    EXPECT_LE(either - both, 4);
    EXPECT_NEAR(float_at(frame, 0), s.world.time, 1e-6);
    EXPECT_EQ(float_at(frame, 4), 123);
    EXPECT_EQ(float_at(frame, 8), 3);  // steps, of which converged:
    EXPECT_EQ(float_at(frame, 12), 2);
    const Pose<double> bone = bone_pose(s.world, s.fingers[0]);
    EXPECT_NEAR(float_at(frame, 24), bone.position.z, 1e-8);
    EXPECT_NEAR(float_at(frame, 44), s.world.contact_surfaces[0].normal_force, 1e-6);
    double pressure = 0;
    for (std::size_t i = 0; i < nodes; ++i) {
        std::int16_t x[3];
        std::uint16_t p;
        std::memcpy(x, &frame[60 + 10 * i], 6);
        std::memcpy(&p, &frame[60 + 10 * i + 6], 2);
        for (int d = 0; d < 3; ++d) EXPECT_NEAR(2e-6 * x[d], finger["rest"][3 * i + d].get<double>(), 4e-3);
        pressure = std::max(pressure, 1e-3 * float_at(frame, 52) * p);
    }
    const std::vector<double> felt_pressure = node_pressures(s.world, s.fingers[0]);
    const double peak = 1e-3 * *std::max_element(felt_pressure.begin(), felt_pressure.end());
    EXPECT_GT(peak, 1);  // kPa
    EXPECT_NEAR(pressure, peak, 1e-4 * peak);
    for (const auto& t : finger["triangles"]) EXPECT_LT(t.get<std::size_t>(), nodes);
    // The hand of the page is the picture's, to a tenth of a millimetre.
    const HandParts parts = hands_of(s.scene)[0];
    HandPoser poser(s, parts);
    const Surface skin = posed_skin(parts, poser.pose(s));
    const auto& rest = model["hand_skin"];
    ASSERT_EQ(rest["vertices"].size(), 3 * skin.vertices.size());
    EXPECT_EQ(model["hands"][0]["triangles"].size(), 3 * skin.triangles.size());
    auto moved = [&](std::size_t vertex, int bone, int row) {
        const std::size_t at = frame.size() - hand_bytes + std::size_t(bone) * 30;
        double x = float_at(frame, at + 18 + 4 * std::size_t(row));
        for (int d = 0; d < 3; ++d) {
            std::int16_t entry;
            std::memcpy(&entry, &frame[at + 2 * std::size_t(3 * row + d)], 2);
            x += entry / 4096.0 * 1e-5 * rest["vertices"][3 * vertex + std::size_t(d)].get<double>();
        }
        return x;
    };
    for (std::size_t v = 0; v < skin.vertices.size(); v += 7)
        for (int d = 0; d < 3; ++d) {
            const double w = 0.01 * rest["second"][v].get<double>();
            const double x = (1 - w) * moved(v, rest["bones"][2 * v], d) + w * moved(v, rest["bones"][2 * v + 1], d);
            ASSERT_NEAR(x, skin.vertices[v][std::size_t(d)], 1.5e-4) << "vertex " << v;
        }
}

/// What encodeURIComponent() wrote.
std::string decoded(const std::string& text) {
    std::string out;
    for (std::size_t i = 0; i < text.size(); ++i) {
        out += text[i] == '%' ? char(std::stoi(text.substr(i + 1, 2), nullptr, 16)) : text[i];
        if (text[i] == '%') i += 2;
    }
    return out;
}
/// Whether every element of a document is closed, in order, and no text holds a bare < or &; attributes in double
/// quotes.
bool well_formed(const std::string& xml) {
    std::vector<std::string> open;
    for (std::size_t at = 0; at < xml.size();) {
        if (xml[at] == '&' && xml.compare(at, 2, "&#") != 0) return false;
        if (xml[at++] != '<') continue;
        const std::size_t end = xml.find('>', at);
        if (end == std::string::npos) return false;
        const std::string tag = xml.substr(at, end - at), name = tag.substr(0, tag.find_first_of(" /", 1));
        at = end + 1;
        if (tag.find('<') != std::string::npos || std::count(tag.begin(), tag.end(), '"') % 2) return false;
        if (tag[0] == '/') {
            if (open.empty() || "/" + open.back() != tag) return false;
            open.pop_back();
        } else if (tag.back() != '/') {
            open.push_back(name);
        }
    }
    return open.empty();
}
/// The points of the first curve of a quantity in plots as SVG: times and values.
std::vector<std::pair<double, double>> curve_of(const std::string& svg, const std::string& quantity) {
    const std::size_t plot = svg.find("data-quantity=\"" + quantity + "\"");
    if (plot == std::string::npos) return {};
    const std::size_t at = svg.find("points=\"", svg.find("class=\"curve\"", plot)) + 8;
    std::istringstream points(svg.substr(at, svg.find('"', at) - at));
    std::vector<std::pair<double, double>> out;
    char comma;
    for (double t, v; points >> t >> comma >> v;) out.emplace_back(t, v);
    return out;
}

std::vector<std::uint8_t> from_base64(const std::string& text) {
    static const std::string digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    std::vector<std::uint8_t> out;
    unsigned word = 0, bits = 0;
    for (const char c : text) {
        if (c == '=') break;
        word = word << 6 | unsigned(digits.find(c)), bits += 6;
        if (bits >= 8) bits -= 8, out.push_back(std::uint8_t(word >> bits & 255));
    }
    return out;
}

/// An hour's session is no page of gigabytes: frames are thinned, and those that stay tell of all steps.
TEST(Stage, AReportOfALongRunHasFewerFramesOfAllItsSteps) {
    Simulation s = make_simulation(load_scene(scenes + "press.toml"), 1);
    RenderedPads pads(s);
    DrawnHands hands(s);
    std::vector<std::uint8_t> one;
    append_frame(one, s, pads.solve(s), hands, {});
    const nlohmann::json model = page_model(s), &finger = model["fingers"][0];
    const std::size_t outline_at = 60 + 10 * finger["rest"].size() / 3 + 6 * finger["samples"].size();
    const std::size_t most = 20 * one.size();
    ReportRecorder all(1000), few(1000, most);
    double longest = 0;
    int converged = 0;
    constexpr int steps = 99;
    for (int k = 0; k < steps; ++k) {
        advance(s);
        longest = std::max(longest, 1e6 * s.world.profile.total());
        converged += skin_status(s.world, s.fingers[0]).converged;
        all.record(s), few.record(s);
    }
    auto frames_of = [&](const ReportRecorder& r) {
        const std::string page = r.page(s, summarise(s)), mark = "\"frames\":\"";
        const std::size_t begin = page.find(mark) + mark.size();
        return from_base64(page.substr(begin, page.find('"', begin) - begin));
    };
    EXPECT_GT(frames_of(all).size(), 90 * one.size());
    const std::vector<std::uint8_t> frames = frames_of(few);
    EXPECT_LE(frames.size(), most);
    EXPECT_GT(frames.size(), most / 3);
    double told = 0, told_longest = 0, told_converged = 0, time = 0;
    for (std::size_t at = 0; at < frames.size();) {
        EXPECT_GT(float_at(frames, at), time);
        time = float_at(frames, at);
        told_longest = std::max<double>(told_longest, float_at(frames, at + 4));
        told += float_at(frames, at + 8), told_converged += float_at(frames, at + 12);
        at += one.size() + 6 * std::size_t(frames[at + outline_at] + 256 * frames[at + outline_at + 1]);
    }
    EXPECT_GT(time, s.world.time - 8 * s.world.solver.dt);
    EXPECT_GT(told, steps - 8);
    EXPECT_LE(told, steps);
    EXPECT_NEAR(told_converged, told, 3 + steps - converged);
    EXPECT_LE(told_longest, longest * (1 + 1e-6));
    EXPECT_NE(few.page(s, summarise(s)).find("(at most 25 per second)"), std::string::npos);
}
TEST(Report, IsOneFileThatABrowserPlays) {
    testing::ScratchFolder scratch;
    const std::string file = (scratch.path / "report.html").string(), out = (scratch.path / "out").string();
    ASSERT_EQ(std::system((testing::program_path() + " run " + scenes + "press.toml --quiet --no-picture --out " + out +
                           " --report " + file)
                              .c_str()),
              0);
    std::ifstream in(file);
    std::stringstream text;
    text << in.rdbuf();
    EXPECT_LT(text.str().size(), 10'000'000u);
    EXPECT_EQ(text.str().find("src=\"http"), std::string::npos);  // opens offline
    EXPECT_EQ(text.str().find("/*DATA*/"), std::string::npos);
    if (!browser_is_installed()) GTEST_SKIP() << "no browser to open it with (Debian package chromium)";
    const std::string at = "file://" + file;
    const std::string before = page_of(at + "#t=0&still=1&probe=1"),
                      during = page_of(at + "#t=0.5&still=1&probe=1&hover=0.4");
    for (const std::string* page : {&before, &during}) {
        EXPECT_EQ(attribute(*page, "data-ready"), "1");
        EXPECT_EQ(attribute(*page, "data-error"), "");
        EXPECT_GT(std::atoi(attribute(*page, "data-colours").c_str()), 50) << "the picture is blank";
    }
    // By keys: to the end, three frames back, one finger alone, the list of keys.
    const std::string typed = page_of(at + "#still=1&keys=End,ArrowLeft,ArrowLeft,ArrowLeft,1,?");
    const std::string chosen = page_of(at + "#still=1&plots=area,joints&keys=End,z&svg=1");
    EXPECT_EQ(attribute(typed, "data-error"), "");
    EXPECT_NEAR(std::stod(attribute(chosen, "data-time")) - std::stod(attribute(typed, "data-time")), 0.1, 0.02);
    // What a pointer over the first plot reads is the table's.
    std::istringstream hover(attribute(during, "data-hover"));
    double time = 0, force = 0, in_table = -1;
    std::string unit, line;
    EXPECT_TRUE(hover >> time >> unit >> force);
    std::ifstream table(out + "/index.csv");
    std::getline(table, line);
    ASSERT_EQ(line.substr(0, line.find(',', line.find(',') + 1)), "time_s,contact_force_N") << line;
    while (std::getline(table, line))
        if (std::abs(std::stod(line) - time) < 1e-3) in_table = std::stod(line.substr(line.find(',') + 1));
    EXPECT_NEAR(force, in_table, 1e-3 * in_table);
    EXPECT_GT(force, 0.1);
    // Plots are chosen, zoomed to the second half and saved; what they hold is the table's.
    const std::string svg = decoded(attribute(chosen, "data-svg"));
    EXPECT_EQ(attribute(chosen, "data-error"), "");
    EXPECT_TRUE(well_formed(svg)) << svg;
    EXPECT_TRUE(curve_of(svg, "force").empty() && curve_of(svg, "step").empty());
    for (const auto& [quantity, name] : {std::pair{"area", "contact_area_mm2"}, {"joints", "q1_deg"}}) {
        const auto curve = curve_of(svg, quantity);
        const auto column = column_by_ms(out + "/index.csv", name);
        ASSERT_GT(curve.size(), 5u) << quantity;
        EXPECT_GT(curve.front().first, 0.25) << quantity;
        for (const auto& [t, v] : curve) {
            const int ms = int(std::lround(1e3 * t));
            ASSERT_TRUE(column.contains(ms)) << t;
            EXPECT_NEAR(v, column.at(ms), 1e-4 * std::abs(v) + 1e-4) << quantity << " at " << t;
        }
    }
    const std::string next = decoded(attribute(page_of(at + "#still=1&keys=q,q,q&svg=1"), "data-svg"));
    EXPECT_FALSE(curve_of(next, "peak").empty());
    EXPECT_TRUE(curve_of(next, "area").empty() && curve_of(next, "felt").empty());
    // On a phone, and in the dark, nothing fails.
    for (const testing::BrowserWindow& window :
         {testing::BrowserWindow{390, 800, false, testing::screenshots() / "report-390.png"},
          {1600, 900, true, testing::screenshots() / "report.png"}}) {
        if (window.dark && !testing::is_tried(1, 2)) continue;
        const std::string page = page_of(at + "#t=0.5&still=1&probe=1", window);
        EXPECT_EQ(attribute(page, "data-error"), "") << window.width;
        EXPECT_GT(std::atoi(attribute(page, "data-colours").c_str()), 50) << window.width;
        EXPECT_GT(std::filesystem::file_size(window.screenshot), 20'000u);
    }
    // Contact shows: pixels of the scale's deep red.
    EXPECT_GT(std::atoi(attribute(during, "data-red").c_str()), std::atoi(attribute(before, "data-red").c_str()) + 20);
}

TEST(ViewServer, DoesNotWaitForAClientThatDoesNotRead) {
    ViewServer server(0, false);
    const int s = socket(AF_INET, SOCK_STREAM, 0);
    sockaddr_in to{};
    to.sin_family = AF_INET;
    to.sin_port = htons(std::uint16_t(server.port()));
    to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    ASSERT_EQ(connect(s, reinterpret_cast<sockaddr*>(&to), sizeof to), 0);
    const std::string hello = "GET /frames?token=" + server.token() +
                              " HTTP/1.1\r\nHost: x\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
                              "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n";
    ASSERT_EQ(write(s, hello.data(), hello.size()), ssize_t(hello.size()));
    char answer[12] = "";
    ASSERT_EQ(read(s, answer, sizeof answer), ssize_t(sizeof answer));
    EXPECT_EQ(std::string(answer, 12), "HTTP/1.1 101");
    const auto start = std::chrono::steady_clock::now();
    for (int i = 0; i < 200; ++i) {  // far more than a socket holds
        std::vector<std::uint8_t> frame(1'000'000, 7);
        server.publish(frame);
        server.tell({{"error", "x"}});
        server.set_page("page " + std::to_string(i));
        usleep(1000);
    }
    EXPECT_LT(std::chrono::steady_clock::now() - start, std::chrono::seconds(20));  // 0.3 s, or for ever
    close(s);
}

/// A client of the live server that keeps what it gets.
struct Client {
    mg_connection* connection = nullptr;
    std::mutex mutex;
    std::condition_variable changed;
    std::vector<float> times, forces;
    std::vector<std::string> texts;
    bool closed = false;

    Client(int port, const std::string& token, const char* origin = nullptr) {
        char error[200] = "";
        const std::string path = "/frames?token=" + token;
        connection = mg_connect_websocket_client(
            "127.0.0.1", port, 0, error, sizeof error, path.c_str(), origin,
            [](mg_connection*, int kind, char* data, std::size_t size, void* user) -> int {
                Client& c = *static_cast<Client*>(user);
                const std::lock_guard lock(c.mutex);
                if ((kind & 0xf) == MG_WEBSOCKET_OPCODE_BINARY && size >= 4) {
                    float time;
                    std::memcpy(&time, data, 4);
                    c.times.push_back(time);
                    if (size >= 44) {
                        float force;  // of the first finger
                        std::memcpy(&force, data + 44, 4);
                        c.forces.push_back(force);
                    }
                } else if ((kind & 0xf) == MG_WEBSOCKET_OPCODE_TEXT) {
                    c.texts.emplace_back(data, size);
                }
                c.changed.notify_all();
                return 1;
            },
            [](const mg_connection*, void* user) {
                Client& c = *static_cast<Client*>(user);
                const std::lock_guard lock(c.mutex);
                c.closed = true;
                c.changed.notify_all();
            },
            this);
    }
    ~Client() {
        if (connection) mg_close_connection(connection);
    }
    void send(const std::string& text) {
        mg_websocket_client_write(connection, MG_WEBSOCKET_OPCODE_TEXT, text.data(), text.size());
    }
    template <class Condition>
    bool wait_for(Condition condition) {
        std::unique_lock lock(mutex);
        return changed.wait_for(lock, std::chrono::seconds(100), condition);
    }
};

TEST(ViewServer, ServesFramesAndTakesCommandsButNotFromStrangers) {
    ViewServer server(0, false);
    server.set_page("<p>hello</p>");
    Client client(server.port(), server.token());
    ASSERT_TRUE(client.connection);
    std::vector<std::uint8_t> frame(8, 0);
    auto waits = [&] {
        const std::lock_guard lock(client.mutex);
        return client.times.empty();
    };
    for (int i = 0; i < 200 && waits(); ++i) {  // until the handshake is through
        frame.assign(8, 0);
        server.publish(frame);
        usleep(10'000);
    }
    EXPECT_TRUE(client.wait_for([&] { return !client.times.empty(); }));
    for (const char* text : {"{\"pause\":true}", "[1,2]", "{", "null", "\xff\xfe", ""}) client.send(text);
    std::vector<ViewCommand> commands;
    for (int i = 0; i < 200 && commands.empty(); ++i, usleep(10'000)) commands = server.take_commands();
    ASSERT_EQ(commands.size(), 1u);
    EXPECT_EQ(commands[0].what["pause"], true);
    EXPECT_TRUE(commands[0].local);
    client.send("{\"set\":[\"" + std::string(5000, 'x') + "\"]}");
    EXPECT_TRUE(client.wait_for([&] { return client.closed; }));
    EXPECT_TRUE(server.take_commands().empty());
    Client stranger(server.port(), server.token(), "http://example.com");
    EXPECT_FALSE(stranger.connection);
    EXPECT_THROW(ViewServer(server.port(), false), InputError);
}

TEST(View, ShowsARunThatObeys) {
    testing::ask_to_be_served_first();
    testing::ScratchFolder scratch;
    const std::string log = (scratch.path / "log").string();
    const pid_t child = fork();
    if (child == 0) {
        if (!freopen(log.c_str(), "w", stdout)) _exit(3);
        // Long enough that it does not begin again before what is sent has come.
        execl(testing::program_path().c_str(), "palpate", "view", (scenes + "press.toml").c_str(), "--port", "0",
              "--set", "duration_s=60", nullptr);
        _exit(4);
    }
    int port = 0;
    char token[64] = "";
    for (int i = 0; i < 5000 && port == 0; ++i, usleep(20'000)) {
        std::ifstream in(log);
        std::string line;
        while (line.find("open ") != 0 && std::getline(in, line)) {}
        std::sscanf(line.c_str(), "open http://127.0.0.1:%d/?token=%40[0-9a-f]", &port, token);
    }
    ASSERT_GT(port, 0);
    {
        Client client(port, token);
        ASSERT_TRUE(client.connection);
        EXPECT_TRUE(client.wait_for([&] { return client.times.size() > 5 && client.times.back() > 0.5f; }));
        client.send(R"({"pause":true})");
        client.send(R"({"set":["finger.index.material.young_kPa=90"]})");
        client.send(R"({"pause":false})");
        // Stiffer tissue presses harder, and the run goes on: its time does not fall back before the force has risen.
        float before = 0, until = 0;
        EXPECT_TRUE(client.wait_for([&] {
            for (std::size_t i = 1; i < client.times.size(); ++i) {
                if (client.times[i] > 0.5f && before == 0) before = client.forces[i], until = client.times[i];
                if (before > 0 && client.times[i] < until) return false;
                if (before > 0 && client.forces[i] > 1.1f * before) return true;
                if (before > 0) until = client.times[i];
            }
            before = 0;
            return false;
        }));
        client.send(R"({"set":["finger.index.material.young_kPa=-1"]})");
        EXPECT_TRUE(client.wait_for([&] {
            for (const auto& t : client.texts)
                if (t.find("young_kPa") != std::string::npos) return true;
            return false;
        }));
        // It says which preset holds real time, and how far from it the run is: on any machine between none and a bit
        // more.
        nlohmann::json pace;
        EXPECT_TRUE(client.wait_for([&] {
            for (const auto& t : client.texts)
                if (t.find("\"pace\"") != std::string::npos) pace = nlohmann::json::parse(t);
            return !pace.is_null();
        }));
        EXPECT_GT(pace.value("pace", 0.0), 0.0);
        EXPECT_LT(pace.value("pace", 9.0), 1.5);
        EXPECT_TRUE(pace.value("holds_time", false));
        const std::string preset = pace.value("preset", "");
        EXPECT_EQ(std::count(preset_names().begin(), preset_names().end(), preset), 1) << preset;
        client.send(R"({"set":["finger.index.device.method=plane"]})");
        client.send(R"({"restart":true})");
        EXPECT_TRUE(client.wait_for([&] {
            for (std::size_t i = 1; i < client.times.size(); ++i)
                if (client.times[i] < client.times[i - 1]) return true;
            return false;
        }));
        if (browser_is_installed()) {
            const std::string url =
                "http://127.0.0.1:" + std::to_string(port) + "/?token=" + std::string(token) + "#probe=1";
            EXPECT_EQ(what_a_browser_says(url, "first picture drawn"), "first picture drawn");
            EXPECT_EQ(what_a_browser_says(url, "pace shown: live: "), "pace shown: live: ");
        }
    }
    kill(child, SIGINT);
    int status = 0;
    waitpid(child, &status, 0);
    EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0);
}

}  // namespace
}  // namespace palpate
