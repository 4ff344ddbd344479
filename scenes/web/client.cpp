#include "scenes/web/client.h"

#include <arpa/inet.h>
#include <netdb.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/random.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <cstring>
#include <memory>
#include <stdexcept>
#include <thread>

#include "scenes/web/websocket.h"

namespace palpate {

namespace {

using Clock = std::chrono::steady_clock;

struct Stopped : std::runtime_error {
    Stopped() : std::runtime_error("stopped") {}
};

/// A connection whose every wait ends when it is told to stop.
class Socket {
  public:
    explicit Socket(int stop_fd) : stop_fd_(stop_fd) {}
    ~Socket() {
        if (fd_ >= 0) ::close(fd_);
    }
    Socket(const Socket&) = delete;
    Socket& operator=(const Socket&) = delete;

    void connect(const sockaddr_in& to, double within_s) {
        fd_ = ::socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
        const int yes = 1;
        setsockopt(fd_, IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes);
        setsockopt(fd_, SOL_SOCKET, SO_KEEPALIVE, &yes, sizeof yes);
        if (::connect(fd_, reinterpret_cast<const sockaddr*>(&to), sizeof to) == 0) return;
        if (errno != EINPROGRESS) throw std::runtime_error(std::strerror(errno));
        deadline_in(within_s);
        wait(POLLOUT);
        int error = 0;
        socklen_t size = sizeof error;
        getsockopt(fd_, SOL_SOCKET, SO_ERROR, &error, &size);
        if (error) throw std::runtime_error(std::strerror(error));
    }
    /// Waits from now on end with an error at that time; 0: never.
    void deadline_in(double s) {
        has_deadline_ = s > 0;
        deadline_ = Clock::now() + std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(s));
    }
    void send(std::span<const std::uint8_t> bytes) {
        while (!bytes.empty()) {
            const ssize_t n = ::send(fd_, bytes.data(), bytes.size(), MSG_NOSIGNAL);
            if (n > 0) bytes = bytes.subspan(std::size_t(n));
            if (n > 0) continue;
            if (errno != EAGAIN && errno != EINTR) throw std::runtime_error(std::strerror(errno));
            wait(POLLOUT);
        }
    }
    /// At least one byte.
    std::span<const std::uint8_t> receive() {
        while (true) {
            wait(POLLIN);
            const ssize_t n = ::recv(fd_, buffer_, sizeof buffer_, 0);
            if (n > 0) return {buffer_, std::size_t(n)};
            if (n == 0) throw std::runtime_error("closed by the other end");
            if (errno != EAGAIN && errno != EINTR) throw std::runtime_error(std::strerror(errno));
        }
    }

  private:
    void wait(short what) const {
        while (true) {
            const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(deadline_ - Clock::now()).count();
            if (has_deadline_ && left <= 0) throw std::runtime_error("no answer");
            pollfd p[2] = {{fd_, what, 0}, {stop_fd_, POLLIN, 0}};
            ::poll(p, 2, has_deadline_ ? int(left) + 1 : -1);
            if (p[1].revents) throw Stopped();
            if (p[0].revents) return;
        }
    }
    int stop_fd_, fd_ = -1;
    bool has_deadline_ = false;
    Clock::time_point deadline_{};
    std::uint8_t buffer_[16384];
};

/// The address of a host. Names are looked up by a thread of their own, since nothing can interrupt that.
sockaddr_in address_of(const WebConversation& c, int stop_fd) {
    sockaddr_in to{};
    to.sin_family = AF_INET;
    to.sin_port = htons(std::uint16_t(c.port));
    if (inet_pton(AF_INET, c.host.c_str(), &to.sin_addr) == 1) return to;
    struct Lookup {
        std::atomic<in_addr_t> found{INADDR_NONE};
        int done_fd = eventfd(0, EFD_CLOEXEC);
        ~Lookup() { ::close(done_fd); }
    };
    const auto lookup = std::make_shared<Lookup>();
    std::thread([lookup, host = c.host] {
        addrinfo hints{}, *list = nullptr;
        hints.ai_family = AF_INET, hints.ai_socktype = SOCK_STREAM;
        if (getaddrinfo(host.c_str(), nullptr, &hints, &list) == 0 && list) {
            lookup->found = reinterpret_cast<const sockaddr_in*>(list->ai_addr)->sin_addr.s_addr;
            freeaddrinfo(list);
        }
        const std::uint64_t one = 1;
        [[maybe_unused]] const auto n = ::write(lookup->done_fd, &one, sizeof one);
    }).detach();
    pollfd p[2] = {{lookup->done_fd, POLLIN, 0}, {stop_fd, POLLIN, 0}};
    ::poll(p, 2, 15000);
    if (p[1].revents) throw Stopped();
    to.sin_addr.s_addr = lookup->found;
    if (to.sin_addr.s_addr == INADDR_NONE) throw std::runtime_error("no host is called " + c.host);
    return to;
}

Mask random_mask() {
    Mask mask{};
    [[maybe_unused]] const auto n = getrandom(mask.data(), mask.size(), 0);
    return mask;
}

/// Returns what came behind the answer.
std::string shake_hands(const WebConversation& c, Socket& socket) {
    std::array<std::uint8_t, 16> bytes{};
    [[maybe_unused]] const auto n = getrandom(bytes.data(), bytes.size(), 0);
    const std::string key = encode_base64(bytes);
    socket.deadline_in(c.connect_s);
    socket.send(bytes_of("GET " + c.path + " HTTP/1.1\r\nHost: " + c.host + ":" + std::to_string(c.port) +
                         "\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Key: " + key +
                         "\r\nSec-WebSocket-Version: 13\r\n\r\n"));
    std::string text;
    std::size_t end = std::string::npos;
    while (end == std::string::npos) {
        const auto got = socket.receive();
        text.append(reinterpret_cast<const char*>(got.data()), got.size());
        end = text.find("\r\n\r\n");
        if (end == std::string::npos && text.size() > 8192) throw std::runtime_error("no WebSocket");
    }
    const auto head = parse_head(std::string_view(text).substr(0, end));
    if (!head || head->line[1] != "101" || head->field("sec-websocket-accept") != accept_key(key))
        throw std::runtime_error("no WebSocket");
    socket.deadline_in(0);
    return text.substr(end + 4);
}

void talk(const WebConversation& c, Socket& socket, const std::string& first) {
    MessageReader reader(c.message_bytes, false);
    auto say = [&](Opcode opcode, std::string_view text) {
        Bytes out;
        const Mask mask = random_mask();
        append_message(out, opcode, bytes_of(text), &mask);
        socket.deadline_in(c.connect_s);
        socket.send(out);
        socket.deadline_in(0);
    };
    if (c.connected)
        for (const std::string& hello : c.connected()) say(Opcode::text, hello);
    reader.add(bytes_of(first));
    while (true) {
        while (const auto message = reader.next()) {
            if (message->opcode == Opcode::text && c.message) c.message(message->payload);
            if (message->opcode == Opcode::ping) say(Opcode::pong, message->payload);
            if (message->opcode == Opcode::close) throw std::runtime_error("closed by the other end");
        }
        if (reader.wrong() == MessageReader::too_large && c.too_large) c.too_large();
        if (reader.wrong()) throw std::runtime_error("a message that breaks the protocol");
        reader.add(socket.receive());
    }
}

}  // namespace

std::string converse(const WebConversation& c, int stop_fd) try {
    Socket socket(stop_fd);
    socket.connect(address_of(c, stop_fd), c.connect_s);
    talk(c, socket, shake_hands(c, socket));
    return "";
} catch (const std::exception& error) { return error.what(); }

}  // namespace palpate
