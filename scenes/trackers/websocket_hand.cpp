#include "scenes/trackers/websocket_hand.h"

#include <civetweb.h>

#include <atomic>

#include "meshes/input_error.h"

namespace palpate {

namespace {

constexpr int most_clients = 8;
constexpr std::size_t largest_message = 65536;

class WebsocketHands : public HandSourceThread {
  public:
    WebsocketHands(HandMailbox& mailbox, int port, bool any_address) : mailbox_(mailbox), any_address_(any_address) {
        const std::string address = (any_address ? "" : "127.0.0.1:") + std::to_string(port);
        const char* options[] = {
            "listening_ports",      address.c_str(), "num_threads", "12", "request_timeout_ms", "5000",
            "websocket_timeout_ms", "3600000",       nullptr};
        mg_init_library(MG_FEATURES_WEBSOCKET);
        mg_callbacks callbacks{};
        context_ = mg_start(&callbacks, this, options);
        if (!context_) {
            mg_exit_library();
            throw InputError("cannot receive hands on port " + std::to_string(port) +
                             ": is another program using it? Choose another one");
        }
        mg_server_port listening[4];
        if (mg_get_server_ports(context_, 4, listening) > 0) port_ = listening[0].port;
        mg_set_websocket_handler(
            context_, "/hand",
            [](const mg_connection* c, void* data) -> int {
                WebsocketHands& self = of(data);
                if (!self.trusted(c)) return 1;
                if (++self.clients_ <= most_clients) return 0;
                --self.clients_;
                return 1;
            },
            [](mg_connection*, void* data) { of(data).mailbox_.count_connection(); },
            [](mg_connection*, int kind, char* text, std::size_t size, void* data) -> int {
                if ((kind & 0xf) == MG_WEBSOCKET_OPCODE_CONNECTION_CLOSE) return 0;
                if ((kind & 0xf) != MG_WEBSOCKET_OPCODE_TEXT) return 1;
                if (size > largest_message) {
                    of(data).mailbox_.count_malformed("a message of more than 64 kB");
                    return 0;
                }
                take_joints(of(data).mailbox_, text, size);
                return 1;
            },
            [](const mg_connection*, void* data) { --of(data).clients_; }, this);
    }
    ~WebsocketHands() override {
        mg_stop(context_);
        mg_exit_library();
    }
    std::string about() const override { return "ws://127.0.0.1:" + std::to_string(port_) + "/hand"; }
    int port() const override { return port_; }

  private:
    static WebsocketHands& of(void* data) { return *static_cast<WebsocketHands*>(data); }
    /// A page of another site must not move the hands of whoever visits it; one served by this machine may.
    bool trusted(const mg_connection* c) const {
        const char* header = mg_get_header(c, "Origin");
        if (!header || any_address_) return true;
        std::string host = header;
        for (const char* scheme : {"http://", "https://"})
            if (host.rfind(scheme, 0) == 0) host = host.substr(std::string(scheme).size());
        for (const char* local : {"127.0.0.1", "localhost", "[::1]"}) {
            const std::string name = local;
            if (host == name || host.rfind(name + ":", 0) == 0) return true;
        }
        return false;
    }
    HandMailbox& mailbox_;
    bool any_address_;
    mg_context* context_ = nullptr;
    int port_ = 0;
    std::atomic<int> clients_{0};
};

}  // namespace

std::unique_ptr<HandSourceThread> receive_websocket_hands(HandMailbox& mailbox, int port, bool any_address) {
    return std::make_unique<WebsocketHands>(mailbox, port, any_address);
}

}  // namespace palpate
