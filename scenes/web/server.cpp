#include "scenes/web/server.h"

#include <arpa/inet.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <mutex>
#include <thread>

#include "meshes/input_error.h"

namespace palpate {

namespace {

using Clock = std::chrono::steady_clock;
Clock::duration seconds(double s) {
    return std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(s));
}

struct Connection {
    enum class Phase { request, response, socket };
    int fd = -1;
    WebPeer peer;
    Phase phase = Phase::request;
    Clock::time_point deadline;  ///< of the request, of the response; of a WebSocket while something waits for it
    std::string head;            ///< of the request, so far
    MessageReader reader;
    Bytes out;
    std::size_t sent = 0;  ///< of out
    std::int64_t frame = 0;
    std::string held;     ///< the newest text that it had no room for
    bool ending = false;  ///< once everything is sent
    bool closed = false;
    bool drained() const { return sent == out.size(); }
    std::size_t waiting() const { return out.size() - sent; }
};

int listen_on(int port, bool any_address, int& taken) {
    const int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    const int yes = 1;
    setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(std::uint16_t(port));
    address.sin_addr.s_addr = htonl(any_address ? INADDR_ANY : INADDR_LOOPBACK);
    socklen_t size = sizeof address;
    if (fd >= 0 && bind(fd, reinterpret_cast<sockaddr*>(&address), size) == 0 && listen(fd, 128) == 0 &&
        getsockname(fd, reinterpret_cast<sockaddr*>(&address), &size) == 0) {
        taken = ntohs(address.sin_port);
        return fd;
    }
    if (fd >= 0) close(fd);
    throw InputError("cannot listen on port " + std::to_string(port) + ": is another program using it?");
}

/// A peer that has vanished without a word is noticed within half a minute.
void keep_alive(int fd) {
    const int yes = 1, idle_s = 10, interval_s = 5, probes = 3;
    setsockopt(fd, SOL_SOCKET, SO_KEEPALIVE, &yes, sizeof yes);
    setsockopt(fd, IPPROTO_TCP, TCP_KEEPIDLE, &idle_s, sizeof idle_s);
    setsockopt(fd, IPPROTO_TCP, TCP_KEEPINTVL, &interval_s, sizeof interval_s);
    setsockopt(fd, IPPROTO_TCP, TCP_KEEPCNT, &probes, sizeof probes);
    setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes);
}

void append(Bytes& out, std::string_view text) { out.insert(out.end(), text.begin(), text.end()); }

}  // namespace

struct WebServer::State {
    WebHandlers handlers;
    WebLimits limits;
    int port = 0, listener = -1, wake_fd = -1, last_id = 0;
    std::vector<Connection> connections;  ///< the server thread's own, oldest first
    Bytes current;                        ///< its own, too: the newest frame
    std::int64_t current_number = 0;
    std::atomic<int> sockets{0};
    std::atomic<std::int64_t> missed{0};

    std::mutex mutex;  ///< guards what follows
    std::vector<std::string> texts;
    Bytes newest;
    std::int64_t newest_number = 0;
    bool ending = false, drop = false;
    std::thread thread;

    void wake() const {
        const std::uint64_t one = 1;
        [[maybe_unused]] const auto n = ::write(wake_fd, &one, sizeof one);
    }
    void serve();
    void accept_all();
    void make_room();
    void receive(Connection& c);
    void take_head(Connection& c);
    void answer(Connection& c, const WebReply& reply);
    bool upgrade(Connection& c, const HttpHead& head);
    void take_messages(Connection& c);
    void send_held(Connection& c);
    void give(Connection& c, const std::string& text);
    void hand_out();
    void flush(Connection& c);
    void close_overdue();
    void remove_closed();
};

void WebServer::State::make_room() {
    while (connections.size() >= limits.connections) {
        const auto oldest = std::find_if(connections.begin(), connections.end(),
                                         [](const Connection& c) { return c.phase != Connection::Phase::socket; });
        if (oldest == connections.end()) return;
        ::close(oldest->fd);
        connections.erase(oldest);
    }
}

void WebServer::State::accept_all() {
    for (std::size_t k = 0; k < limits.connections; ++k) {  // then others have their turn
        sockaddr_in from{};
        socklen_t size = sizeof from;
        const int fd = accept4(listener, reinterpret_cast<sockaddr*>(&from), &size, SOCK_CLOEXEC | SOCK_NONBLOCK);
        if (fd < 0) return;
        make_room();
        keep_alive(fd);
        if (limits.kernel_bytes > 0)
            setsockopt(fd, SOL_SOCKET, SO_SNDBUF, &limits.kernel_bytes, sizeof limits.kernel_bytes);
        Connection c{.fd = fd,
                     .peer = {++last_id, ntohl(from.sin_addr.s_addr) >> 24 == 127},
                     .deadline = Clock::now() + seconds(limits.request_s),
                     .head = {},
                     .reader = MessageReader(limits.message_bytes, true),
                     .out = {},
                     .held = {}};
        connections.push_back(std::move(c));
    }
}

void WebServer::State::receive(Connection& c) {
    std::uint8_t bytes[16384];
    const ssize_t n = recv(c.fd, bytes, sizeof bytes, 0);
    if (n == 0 || (n < 0 && errno != EAGAIN && errno != EINTR)) c.closed = true;
    if (n <= 0) return;
    if (c.ending) return;  // it was told so
    const std::span<const std::uint8_t> got(bytes, std::size_t(n));
    if (c.phase == Connection::Phase::socket) {
        c.reader.add(got);
        return take_messages(c);
    }
    const std::size_t before = c.head.size();
    c.head.append(reinterpret_cast<const char*>(bytes), got.size());
    const auto end = c.head.find("\r\n\r\n", before < 3 ? 0 : before - 3);
    if (end == std::string::npos) {
        if (c.head.size() > limits.request_bytes)
            answer(c, {"431 Request Header Fields Too Large", "text/plain", "the request is too long\n"});
        return;
    }
    const std::string rest = c.head.substr(end + 4);
    c.head.resize(end);
    take_head(c);
    if (c.phase == Connection::Phase::socket) {
        c.reader.add(bytes_of(rest));
        take_messages(c);
    }
}

void WebServer::State::answer(Connection& c, const WebReply& reply) {
    append(c.out, "HTTP/1.1 " + reply.status + "\r\nContent-Type: " + reply.type +
                      "\r\nContent-Length: " + std::to_string(reply.body.size()) +
                      "\r\nCache-Control: no-store\r\nReferrer-Policy: no-referrer\r\nX-Frame-Options: DENY\r\n"
                      "X-Content-Type-Options: nosniff\r\nConnection: close\r\n\r\n");
    append(c.out, reply.body);
    c.phase = Connection::Phase::response;
    c.deadline = Clock::now() + seconds(limits.response_s);
    c.ending = true;
}

void WebServer::State::take_head(Connection& c) {
    const auto head = parse_head(c.head);
    c.head.clear();
    if (!head || !head->line[2].starts_with("HTTP/1.")) return answer(c, {"400 Bad Request", "text/plain", "?\n"});
    if (head->line[0] != "GET") return answer(c, {"405 Method Not Allowed", "text/plain", "only GET\n"});
    if (!head->field("upgrade").empty()) {
        if (!upgrade(c, *head)) answer(c, {"403 Forbidden", "text/plain", "refused\n"});
        return;
    }
    answer(c, handlers.page ? handlers.page(*head) : WebReply{"404 Not Found", "text/plain", "not found\n"});
}

bool WebServer::State::upgrade(Connection& c, const HttpHead& head) {
    std::string kind = head.field("upgrade");
    std::transform(kind.begin(), kind.end(), kind.begin(), [](unsigned char x) { return std::tolower(x); });
    const std::string key = head.field("sec-websocket-key");
    if (kind != "websocket" || head.field("sec-websocket-version") != "13" || key.size() != 24) return false;
    if (std::size_t(sockets) >= limits.sockets || !handlers.accepts || !handlers.accepts(head, c.peer)) return false;
    append(c.out,
           "HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
           "Sec-WebSocket-Accept: " +
               accept_key(key) + "\r\n\r\n");
    c.phase = Connection::Phase::socket;
    ++sockets;
    if (handlers.greeting)
        if (const std::string text = handlers.greeting(); !text.empty())
            append_message(c.out, Opcode::text, bytes_of(text));
    return true;
}

void WebServer::State::take_messages(Connection& c) {
    while (!c.ending) {
        const auto message = c.reader.next();
        if (!message) break;
        if (message->opcode == Opcode::text)
            c.ending = !handlers.message || !handlers.message(c.peer, message->payload);
        // One answer at a time: who asks without reading gets no more of them.
        if (message->opcode == Opcode::ping && c.drained())
            append_message(c.out, Opcode::pong, bytes_of(message->payload));
        if (message->opcode == Opcode::close) c.ending = true;
    }
    if (c.reader.wrong() == MessageReader::too_large && handlers.too_large && !c.ending) handlers.too_large();
    if (c.reader.wrong()) c.ending = true;
    if (!c.ending) return;
    const int code = c.reader.wrong() ? c.reader.wrong() : 1000;
    const std::uint8_t reason[2] = {std::uint8_t(code >> 8), std::uint8_t(code)};
    append_message(c.out, Opcode::close, reason);
}

void WebServer::State::send_held(Connection& c) {
    if (c.held.empty()) return;
    append_message(c.out, Opcode::text, bytes_of(c.held));
    c.held.clear();
}

/// One who is behind misses texts, but has the last of them in the end.
void WebServer::State::give(Connection& c, const std::string& text) {
    if (c.waiting() <= limits.skip_bytes) {
        send_held(c);
        return append_message(c.out, Opcode::text, bytes_of(text));
    }
    missed += !c.held.empty();
    c.held = text;
}

/// Texts and the newest frame, to those who may have them.
void WebServer::State::hand_out() {
    std::vector<std::string> fresh;
    bool last_word = false;
    {
        const std::lock_guard lock(mutex);
        std::swap(fresh, texts);
        std::swap(last_word, drop);
        if (current_number != newest_number) std::swap(current, newest);
        current_number = newest_number;
    }
    for (Connection& c : connections) {
        if (c.phase != Connection::Phase::socket || c.ending) continue;
        const bool was_drained = c.drained();
        if (c.waiting() <= limits.skip_bytes) send_held(c);
        for (const std::string& text : fresh) give(c, text);
        if (last_word) {
            send_held(c);
            append_message(c.out, Opcode::close, {});
            c.ending = true;
            c.deadline = Clock::now() + seconds(limits.farewell_s);
        }
        if (c.waiting() > limits.waiting_bytes + current.size()) c.closed = true;
        if (was_drained && c.frame != current_number) {
            append_message(c.out, Opcode::binary, current);
            c.frame = current_number;
        }
        if (was_drained && !c.drained() && !c.ending) c.deadline = Clock::now() + seconds(limits.response_s);
    }
}

void WebServer::State::flush(Connection& c) {
    if (c.sent > limits.waiting_bytes) {  // one who is always a little behind must not fill the memory
        c.out.erase(c.out.begin(), c.out.begin() + std::ptrdiff_t(c.sent));
        c.sent = 0;
    }
    while (!c.drained()) {
        const ssize_t n = ::send(c.fd, c.out.data() + c.sent, c.waiting(), MSG_NOSIGNAL);
        if (n < 0 && errno != EAGAIN && errno != EINTR) c.closed = true;
        if (n <= 0) return;
        c.sent += std::size_t(n);
        if (c.phase == Connection::Phase::socket)
            c.deadline = Clock::now() + seconds(c.ending ? limits.farewell_s : limits.response_s);
    }
    c.out.clear(), c.sent = 0;
    if (c.ending) c.closed = true;
}

void WebServer::State::close_overdue() {
    const auto now = Clock::now();
    for (Connection& c : connections)
        if (now > c.deadline && (c.phase != Connection::Phase::socket || !c.drained())) c.closed = true;
}

void WebServer::State::remove_closed() {
    std::erase_if(connections, [&](const Connection& c) {
        if (!c.closed) return false;
        ::close(c.fd);
        if (c.phase != Connection::Phase::socket) return true;
        --sockets;
        if (handlers.gone) handlers.gone(c.peer);
        return true;
    });
}

void WebServer::State::serve() {
    std::vector<pollfd> waits;
    while (true) {
        waits = {{listener, POLLIN, 0}, {wake_fd, POLLIN, 0}};
        for (const Connection& c : connections) waits.push_back({c.fd, short(POLLIN | (c.drained() ? 0 : POLLOUT)), 0});
        ::poll(waits.data(), waits.size(), 100);
        std::uint64_t count;
        [[maybe_unused]] const auto n = ::read(wake_fd, &count, sizeof count);
        {
            const std::lock_guard lock(mutex);
            if (ending) return;
        }
        for (std::size_t k = 0; k < connections.size(); ++k)
            if (waits[k + 2].revents & (POLLIN | POLLHUP | POLLERR)) receive(connections[k]);
        hand_out();
        for (Connection& c : connections)
            if (!c.closed) flush(c);
        close_overdue();
        remove_closed();
        if (waits[0].revents) accept_all();
    }
}

WebServer::WebServer(int port, bool any_address, WebHandlers handlers, const WebLimits& limits)
    : state_(std::make_unique<State>()) {
    State& s = *state_;
    s.handlers = std::move(handlers);
    s.limits = limits;
    s.listener = listen_on(port, any_address, s.port);
    s.wake_fd = eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC);
    s.thread = std::thread([&s] { s.serve(); });
}

WebServer::~WebServer() {
    {
        const std::lock_guard lock(state_->mutex);
        state_->ending = true;
    }
    state_->wake();
    state_->thread.join();
    for (const Connection& c : state_->connections) ::close(c.fd);
    ::close(state_->listener);
    ::close(state_->wake_fd);
}

int WebServer::port() const { return state_->port; }
int WebServer::clients() const { return state_->sockets; }
std::int64_t WebServer::missed() const { return state_->missed; }

void WebServer::send_text(const std::string& text) {
    {
        const std::lock_guard lock(state_->mutex);
        if (state_->texts.size() < 1024) state_->texts.push_back(text);  // the thread takes them at once
    }
    state_->wake();
}

void WebServer::send_newest(Bytes& binary) {
    {
        const std::lock_guard lock(state_->mutex);
        std::swap(state_->newest, binary);
        ++state_->newest_number;
    }
    state_->wake();
}

void WebServer::drop_clients() {
    {
        const std::lock_guard lock(state_->mutex);
        state_->drop = true;
    }
    state_->wake();
}

}  // namespace palpate
