#include "scenes/trackers/websocket_hand.h"

#include "meshes/input_error.h"
#include "scenes/web/access.h"
#include "scenes/web/server.h"

namespace palpate {

namespace {

class WebsocketHands : public HandSourceThread {
  public:
    WebsocketHands(HandMailbox& mailbox, int port, bool any_address) : mailbox_(mailbox) {
        if (any_address) token_ = random_token();
        WebHandlers handlers;
        handlers.accepts = [this](const HttpHead& head, const WebPeer& peer) { return accepts(head, peer); };
        handlers.message = [this](const WebPeer& peer, const std::string& text) {
            take_joints(mailbox_, text.data(), text.size(), name_of(peer));
            return true;
        };
        handlers.gone = [this](const WebPeer& peer) { mailbox_.forget(name_of(peer)); };
        handlers.too_large = [this] { mailbox_.count_malformed("a message of more than 64 kB"); };
        try {
            server_ = std::make_unique<WebServer>(port, any_address, std::move(handlers));
        } catch (const InputError&) {
            throw InputError("cannot receive hands on port " + std::to_string(port) +
                             ": is another program using it? Choose another one");
        }
    }
    std::string about() const override {
        return token_.empty() ? "ws://127.0.0.1:" + std::to_string(port()) + "/hand"
                              : "ws://ADDRESS-OF-THIS-MACHINE:" + std::to_string(port()) + "/hand?token=" + token_;
    }
    int port() const override { return server_->port(); }

  private:
    static std::string name_of(const WebPeer& peer) { return "connection " + std::to_string(peer.id); }
    /// A page of another site must not move the hands of whoever visits it; one served by this machine may. From other
    /// machines, and for their pages, it takes the token.
    bool accepts(const HttpHead& head, const WebPeer& peer) {
        const std::string origin = head.field("origin");
        const bool from_here = peer.local && (origin.empty() || is_local_origin(origin));
        const bool welcome =
            head.path() == "/hand" && (from_here || same_token(query_value(head.query(), "token"), token_));
        if (welcome) mailbox_.count_connection();
        return welcome;
    }
    HandMailbox& mailbox_;
    std::string token_;  ///< empty: only this machine is listened to
    std::unique_ptr<WebServer> server_;
};

}  // namespace

std::unique_ptr<HandSourceThread> receive_websocket_hands(HandMailbox& mailbox, int port, bool any_address) {
    return std::make_unique<WebsocketHands>(mailbox, port, any_address);
}

}  // namespace palpate
