// What comes from outside: bounded JSON, WebSockets, the small server and client, and who may connect.

#include "scenes/web/server.h"

#include <arpa/inet.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <unistd.h>

#include <fstream>
#include <nlohmann/json.hpp>

#include "meshes/input_error.h"
#include "scenes/trackers/hand_source.h"
#include "scenes/viewer/server.h"
#include "scenes/web/access.h"
#include "scenes/web/bounded_json.h"
#include "scenes/web/client.h"
#include "tests/support.h"

namespace palpate {
namespace {

using testing::eventually;

TEST(BoundedJson, DepthAndSizeAreBoundedBeforeParsing) {
    auto nested = [](int depth) { return "{\"a\":" + std::string(depth - 1, '[') + std::string(depth - 1, ']') + "}"; };
    std::string wrong;
    EXPECT_TRUE(parse_object(nested(16), wrong).is_object());
    EXPECT_EQ(wrong, "");
    EXPECT_TRUE(parse_object(nested(17), wrong).is_discarded());
    EXPECT_EQ(wrong, "a message nested more than 16 deep");
    EXPECT_TRUE(parse_object(nested(10'000'000), wrong, {std::size_t(1) << 30, 16}).is_discarded());
    parse_object("{\"a\":\"" + std::string(65536, 'x') + "\"}", wrong);
    EXPECT_EQ(wrong, "a message of more than 64 kB");
    // Brackets and quotes inside a text count for nothing, however they are escaped.
    const std::string text = R"({"a":"[[[[[[[[[[[[[[[[[[[[\"{{{{{\\"})";
    EXPECT_TRUE(parse_object(text, wrong).is_object());
    EXPECT_TRUE(parse_object(std::string(20, ']') + "{}", wrong).is_discarded());
    EXPECT_EQ(wrong, "expected a JSON object");
    EXPECT_EQ(shown("\x1b[2J\xc3\xa4"), R"("\u001b[2J\u00e4")") << "nothing that a terminal obeys";
    EXPECT_EQ(shown(nlohmann::json(std::string(1000, 'x'))).size(), 40u);
}

TEST(WebSocket, PublishedExamples) {
    // RFC 6455, 1.3 and 5.7.
    EXPECT_EQ(accept_key("dGhlIHNhbXBsZSBub25jZQ=="), "s3pPLMBiTxaQ9kYGzzhZRbK+xOo=");
    Bytes out;
    append_message(out, Opcode::text, bytes_of("Hello"));
    EXPECT_EQ(out, (Bytes{0x81, 0x05, 0x48, 0x65, 0x6c, 0x6c, 0x6f}));
    out.clear();
    const Mask mask{0x37, 0xfa, 0x21, 0x3d};
    append_message(out, Opcode::text, bytes_of("Hello"), &mask);
    EXPECT_EQ(out, (Bytes{0x81, 0x85, 0x37, 0xfa, 0x21, 0x3d, 0x7f, 0x9f, 0x4d, 0x51, 0x58}));
    MessageReader reader(100, false);
    reader.add(Bytes{0x01, 0x03, 0x48, 0x65, 0x6c, 0x80, 0x02, 0x6c, 0x6f});  // in two fragments
    EXPECT_EQ(reader.next()->payload, "Hello");
}

TEST(WebSocket, MessagesComeThroughInAnyPieces) {
    std::mt19937 random(4);
    for (const bool masked : {false, true})
        for (int run = 0; run < 300; ++run) {
            MessageReader reader(70000, masked);
            Bytes line;
            std::vector<std::string> sent;
            const Mask mask{1, 2, 3, std::uint8_t(random())};
            for (int k = 0; k < 4; ++k) {
                sent.emplace_back(random() % (k == 3 ? 70000 : 200), char('a' + k));
                append_message(line, Opcode::text, bytes_of(sent.back()), masked ? &mask : nullptr);
            }
            std::size_t found = 0;
            for (std::size_t at = 0; at < line.size();) {
                const std::size_t piece = std::min<std::size_t>(1 + random() % 5000, line.size() - at);
                reader.add(std::span(line).subspan(at, piece));
                at += piece;
                while (const auto m = reader.next()) EXPECT_EQ(m->payload, sent.at(found++));
            }
            EXPECT_EQ(found, sent.size());
            EXPECT_EQ(reader.wrong(), 0);
        }
}

TEST(WebSocket, WhatBreaksTheRulesIsSeenInItsHead) {
    auto wrong = [](Bytes bytes, bool masked) {
        MessageReader reader(1000, masked);
        reader.add(bytes);
        EXPECT_FALSE(reader.next());
        return reader.wrong();
    };
    EXPECT_EQ(wrong({0x81, 0x05, 'h'}, true), MessageReader::broken_rules) << "a client that does not mask";
    EXPECT_EQ(wrong({0x81, 0x85, 'h'}, false), MessageReader::broken_rules) << "a server that does";
    EXPECT_EQ(wrong({0x80, 0x01}, false), MessageReader::broken_rules) << "goes on with nothing";
    EXPECT_EQ(wrong({0x83, 0x01}, false), MessageReader::broken_rules) << "an unknown kind";
    EXPECT_EQ(wrong({0x89, 126, 0, 200}, false), MessageReader::broken_rules) << "a long ping";
    EXPECT_EQ(wrong({0x81, 126, 0x03, 0xe9}, false), MessageReader::too_large) << "1,001 bytes";
    EXPECT_EQ(wrong({0x81, 127, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff}, false), MessageReader::too_large);
    MessageReader reader(1000, false);  // fragments add up
    Bytes many;
    append_message(many, Opcode::text, bytes_of(std::string(600, 'x')));
    many[0] = 0x01;
    many.insert(many.end(), {0x80, 126, 0x01, 0x91});  // 401 more
    reader.add(many);
    EXPECT_FALSE(reader.next());
    EXPECT_EQ(reader.wrong(), MessageReader::too_large);
}

TEST(Access, OriginsAreExactAndTokensSecret) {
    for (const char* good : {"http://localhost", "http://localhost:8080", "https://127.0.0.1:1", "http://[::1]:65535"})
        EXPECT_TRUE(is_local_origin(good)) << good;
    for (const char* bad : {"http://localhost:evil", "http://localhost:", "http://localhost:80@evil.com", "null", "",
                            "http://localhost.evil.com", "http://localhost:123456", "ftp://localhost", "localhost",
                            "http://127.0.0.1.evil.com", "http://localhost:80 ", "http://LOCALHOST"})
        EXPECT_FALSE(is_local_origin(bad)) << bad;
    const std::string a = random_token(), b = random_token();
    EXPECT_EQ(a.size(), 32u);
    EXPECT_NE(a, b);
    EXPECT_TRUE(same_token(a, a));
    EXPECT_FALSE(same_token(b, a));
    EXPECT_FALSE(same_token("", a));
    EXPECT_FALSE(same_token(a + "0", a));
    EXPECT_FALSE(same_token("", "")) << "no token lets nobody in";
    EXPECT_EQ(query_value("still=1&token=ab&t=2", "token"), "ab");
    EXPECT_EQ(query_value("xtoken=ab&tokens=c&token", "token"), "");
}

int connect_to(int port) {
    const int s = socket(AF_INET, SOCK_STREAM, 0);
    const timeval patience{20, 0};
    setsockopt(s, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
    sockaddr_in to{};
    to.sin_family = AF_INET;
    to.sin_port = htons(std::uint16_t(port));
    to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    EXPECT_EQ(connect(s, reinterpret_cast<sockaddr*>(&to), sizeof to), 0);
    return s;
}

/// The whole answer to a GET.
std::string get(int port, const std::string& target, const std::string& fields = "Host: x\r\n") {
    const int s = connect_to(port);
    const std::string request = "GET " + target + " HTTP/1.1\r\n" + fields + "\r\n";
    EXPECT_EQ(write(s, request.data(), request.size()), ssize_t(request.size()));
    std::string answer;
    char bytes[4096];
    for (ssize_t n; (n = read(s, bytes, sizeof bytes)) > 0;) answer.append(bytes, std::size_t(n));
    close(s);
    return answer;
}

/// The other side has ended it, now or within so many milliseconds.
bool is_ended(int s, int ms) {
    pollfd p{s, POLLIN, 0};
    char byte;
    return ::poll(&p, 1, ms) > 0 && ::read(s, &byte, 1) <= 0;
}

TEST(ViewServer, SlowConnectionsKeepNobodyOut) {
    ViewServer server(0, false);
    server.set_page("<p>hello</p>");
    std::vector<int> slow;
    for (int k = 0; k < 200; ++k) {
        slow.push_back(connect_to(server.port()));
        if (k % 2) [[maybe_unused]]
            const auto n = write(slow.back(), "GET / HT", 8);
    }
    EXPECT_NE(get(server.port(), "/?token=" + server.token()).find("<p>hello</p>"), std::string::npos);
    // The oldest had to go: so many are kept, however many come.
    const auto kept = std::count_if(slow.begin(), slow.end(), [](int s) { return !is_ended(s, 0); });
    EXPECT_LE(kept, std::ptrdiff_t(WebLimits{}.connections));
    for (const int s : slow) close(s);
}

TEST(ViewServer, WhoeverDoesNotAskInTimeIsSentAway) {
    ViewServer server(0, false);
    const int silent = connect_to(server.port()), slow = connect_to(server.port());
    ASSERT_EQ(write(slow, "GET / HT", 8), 8);
    constexpr int patience_ms = 60'000;  // 2 s are asked for; without an end it would be for ever
    EXPECT_TRUE(is_ended(silent, patience_ms));
    EXPECT_TRUE(is_ended(slow, patience_ms));
    for (const int s : {silent, slow}) close(s);
}

TEST(ViewServer, WithoutItsTokenItShowsNothing) {
    for (const bool any_address : {false, true}) {
        ViewServer server(0, any_address);
        server.set_page("<p>hello</p>");
        const std::string good = "/?token=" + server.token();
        EXPECT_TRUE(server.url().ends_with(good));
        const std::string page = get(server.port(), good);
        EXPECT_TRUE(page.starts_with("HTTP/1.1 200")) << page;
        EXPECT_NE(page.find("<p>hello</p>"), std::string::npos);
        EXPECT_NE(page.find("X-Frame-Options: DENY"), std::string::npos) << "no other page may frame it";
        for (const std::string& target :
             {std::string("/"), std::string("/?token="), "/?token=" + random_token(), good + "0", good.substr(0, 20)}) {
            const std::string answer = get(server.port(), target);
            EXPECT_TRUE(answer.starts_with("HTTP/1.1 403")) << target << answer;
            EXPECT_EQ(answer.find("hello"), std::string::npos);
        }
        EXPECT_TRUE(get(server.port(), "/frames?token=" + server.token()).starts_with("HTTP/1.1 404"));
        EXPECT_TRUE(get(server.port(), good, std::string(9000, 'x')).starts_with("HTTP/1.1 431"));
        EXPECT_TRUE(get(server.port(), good, "nonsense\r\n").starts_with("HTTP/1.1 400"));
    }
}

TEST(ViewServer, OnlyItsOwnPageSteers) {
    const std::string hello =
        "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"
        "Sec-WebSocket-Version: 13\r\n";
    auto status = [&](const ViewServer& server, const std::string& token, const std::string& fields) {
        const int s = connect_to(server.port());
        const std::string request = "GET /frames?token=" + token + " HTTP/1.1\r\n" + fields + hello + "\r\n";
        EXPECT_EQ(write(s, request.data(), request.size()), ssize_t(request.size()));
        char answer[13] = "";
        EXPECT_GT(read(s, answer, 12), 0);
        close(s);
        return std::string(answer).substr(9);
    };
    for (const bool any_address : {false, true}) {
        ViewServer server(0, any_address);
        const std::string host = "localhost:" + std::to_string(server.port());
        EXPECT_EQ(status(server, server.token(), "Host: x\r\n"), "101");
        EXPECT_EQ(status(server, server.token(), "Host: " + host + "\r\nOrigin: http://" + host + "\r\n"), "101");
        EXPECT_EQ(status(server, "", "Host: " + host + "\r\nOrigin: http://" + host + "\r\n"), "403");
        for (const char* origin : {"http://example.com", "http://localhost:evil", "http://localhost:1", "null"})
            EXPECT_EQ(status(server, server.token(), "Host: " + host + "\r\nOrigin: " + origin + "\r\n"), "403")
                << origin;
        EXPECT_EQ(status(server, server.token(), "Host: a:1\r\nOrigin: http://a:1\r\n"), any_address ? "101" : "403")
            << "a name that leads to this machine";
        EXPECT_EQ(status(server, server.token(), "Host: a:1\r\nOrigin: http://b\r\nOrigin: http://a:1\r\n"), "400");
    }
}

TEST(ViewServer, CommandsAreBounded) {
    ViewServer server(0, false);
    const int s = connect_to(server.port());
    const std::string request = "GET /frames?token=" + server.token() +
                                " HTTP/1.1\r\nHost: x\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
                                "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n";
    Bytes out(request.begin(), request.end());
    const Mask mask{1, 2, 3, 4};
    append_message(out, Opcode::text, bytes_of("{\"set\":" + std::string(2000, '[') + std::string(2000, ']') + "}"),
                   &mask);
    append_message(out, Opcode::text, bytes_of("{\"step\":true}"), &mask);
    ASSERT_EQ(write(s, out.data(), out.size()), ssize_t(out.size()));
    std::vector<ViewCommand> commands;
    EXPECT_TRUE(eventually([&] { return !(commands = server.take_commands()).empty(); }));
    ASSERT_EQ(commands.size(), 1u);
    EXPECT_TRUE(commands[0].what.contains("step"));
    EXPECT_TRUE(commands[0].local);
    close(s);
}

/// Somebody who listens, and after that does what a test says.
struct Listener {
    int socket_fd = -1, port = 0;
    Listener() {
        socket_fd = socket(AF_INET, SOCK_STREAM, 0);
        sockaddr_in address{};
        address.sin_family = AF_INET;
        address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
        socklen_t size = sizeof address;
        EXPECT_EQ(bind(socket_fd, reinterpret_cast<sockaddr*>(&address), size), 0);
        EXPECT_EQ(listen(socket_fd, 5), 0);
        getsockname(socket_fd, reinterpret_cast<sockaddr*>(&address), &size);
        port = ntohs(address.sin_port);
    }
    ~Listener() { close(socket_fd); }
};

TEST(Ultraleap, AServiceThatSaysNothingHoldsNobodyUp) {
    const Listener silent;
    auto live = std::make_unique<LiveHands>("ultraleap:127.0.0.1:" + std::to_string(silent.port));
    const int c = accept(silent.socket_fd, nullptr, nullptr);
    ASSERT_GE(c, 0);
    const auto start = std::chrono::steady_clock::now();
    live.reset();
    EXPECT_LT(std::chrono::steady_clock::now() - start, std::chrono::seconds(10));
    close(c);
}

/// Largest resident memory from now on [kB].
int peak_memory(bool reset) {
    if (reset) std::ofstream("/proc/self/clear_refs") << 5;
    std::ifstream in("/proc/self/status");
    for (std::string line; std::getline(in, line);)
        if (line.starts_with("VmHWM:")) return std::atoi(line.c_str() + 6);
    return 0;
}

TEST(Ultraleap, AnEndlessMessageTakesNoMemory) {
    const Listener service;
    LiveHands live("ultraleap:127.0.0.1:" + std::to_string(service.port));
    const int c = accept(service.socket_fd, nullptr, nullptr);
    ASSERT_GE(c, 0);
    std::string request;
    char bytes[1024];
    while (request.find("\r\n\r\n") == std::string::npos) {
        const ssize_t n = read(c, bytes, sizeof bytes);
        ASSERT_GT(n, 0);
        request.append(bytes, std::size_t(n));
    }
    const auto head = parse_head(request.substr(0, request.find("\r\n\r\n")));
    ASSERT_TRUE(head);
    const std::string answer =
        "HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        "Sec-WebSocket-Accept: " +
        accept_key(head->field("sec-websocket-key")) + "\r\n\r\n";
    Bytes out(answer.begin(), answer.end());
    const int before = peak_memory(true);
    std::string endless = "{\"hands\":[";
    endless.resize(20'000'000, '[');
    append_message(out, Opcode::text, bytes_of(endless));
    std::thread sender([&] {
        for (std::size_t at = 0; at < out.size();) {
            const ssize_t n = ::send(c, out.data() + at, std::min<std::size_t>(out.size() - at, 65536), MSG_NOSIGNAL);
            if (n <= 0) return;
            at += std::size_t(n);
        }
    });
    EXPECT_TRUE(eventually([&] { return live.mailbox.counts().last_problem == "a message of more than 64 kB"; }));
    sender.join();
    EXPECT_LT(peak_memory(false) - before, 3 * 20'000 + 5'000) << "kB, of which the sender's are three times 20 MB";
    close(c);
}

}  // namespace
}  // namespace palpate
