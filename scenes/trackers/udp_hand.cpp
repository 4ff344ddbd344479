#include "scenes/trackers/udp_hand.h"

#include <arpa/inet.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <thread>

#include "meshes/input_error.h"

namespace palpate {

namespace {

std::string name_of(const sockaddr_in& from) {
    char text[INET_ADDRSTRLEN] = "";
    inet_ntop(AF_INET, &from.sin_addr, text, sizeof text);
    return std::string(text) + ":" + std::to_string(ntohs(from.sin_port));
}

class UdpHands : public HandSourceThread {
  public:
    UdpHands(HandMailbox& mailbox, int socket, int port)
        : mailbox_(mailbox), socket_(socket), port_(port), receiver_([this] { receive(); }) {}
    ~UdpHands() override {
        ending_ = true;
        receiver_.join();
        close(socket_);
    }
    std::string about() const override { return "UDP port " + std::to_string(port_); }
    int port() const override { return port_; }

  private:
    void receive() {
        std::vector<char> buffer(65536);
        while (!ending_) {
            pollfd p{socket_, POLLIN, 0};
            if (poll(&p, 1, 100) <= 0) continue;
            sockaddr_in from{};
            socklen_t size = sizeof from;
            const ssize_t n =
                recvfrom(socket_, buffer.data(), buffer.size(), 0, reinterpret_cast<sockaddr*>(&from), &size);
            if (n > 0) take_joints(mailbox_, buffer.data(), std::size_t(n), name_of(from));
        }
    }
    HandMailbox& mailbox_;
    int socket_, port_;
    std::atomic<bool> ending_{false};
    std::thread receiver_;
};

}  // namespace

std::unique_ptr<HandSourceThread> receive_udp_hands(HandMailbox& mailbox, int port, bool any_address) {
    const int fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(std::uint16_t(port));
    address.sin_addr.s_addr = htonl(any_address ? INADDR_ANY : INADDR_LOOPBACK);
    socklen_t size = sizeof address;
    if (fd < 0 || bind(fd, reinterpret_cast<sockaddr*>(&address), size) != 0 ||
        getsockname(fd, reinterpret_cast<sockaddr*>(&address), &size) != 0) {
        if (fd >= 0) close(fd);
        throw InputError("cannot receive hands on UDP port " + std::to_string(port) +
                         ": is another program using it? Choose another one");
    }
    return std::make_unique<UdpHands>(mailbox, fd, ntohs(address.sin_port));
}

}  // namespace palpate
