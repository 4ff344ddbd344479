#pragma once
// A small web server: pages over HTTP, messages over WebSockets. One thread serves all connections and waits for none:
// how many there are, how long a request may take, how large a message may be, and how much waits for a slow reader are
// bounded.

#include <functional>
#include <memory>

#include "scenes/web/websocket.h"

namespace palpate {

struct WebLimits {
    std::size_t connections = 64;              ///< a new one beyond them ends the oldest that is no WebSocket yet
    std::size_t sockets = 8;                   ///< WebSockets
    std::size_t request_bytes = 8192;          ///< of a request's head
    std::size_t message_bytes = 65536;         ///< of a message from a client; a longer one ends its connection
    std::size_t waiting_bytes = 4 << 20;       ///< of texts for a client that does not read; more end its connection
    std::size_t skip_bytes = std::size_t(-1);  ///< of texts that wait: a client that is behind by more misses new ones
    int kernel_bytes = 0;                      ///< of what the system holds for a slow reader beside; 0: as it likes
    double request_s = 2;                      ///< from connecting to the end of the request
    double response_s = 30;                    ///< for the page; and for a client that does not read to read something
    double farewell_s = 1;                     ///< the latter, once its connection ends
};

/// Where a WebSocket's messages come from.
struct WebPeer {
    int id = 0;          ///< of the connection, from 1 on
    bool local = false;  ///< from this machine's loopback address
};

struct WebReply {
    std::string status, type, body;  ///< "200 OK", "text/html; charset=utf-8"
};

/// Called by the server's thread; none may wait. Those that are empty accept nothing.
struct WebHandlers {
    std::function<WebReply(const HttpHead&)> page;                    ///< for GET
    std::function<bool(const HttpHead&, const WebPeer&)> accepts;     ///< a WebSocket
    std::function<std::string()> greeting;                            ///< sent to a new WebSocket, unless empty
    std::function<bool(const WebPeer&, const std::string&)> message;  ///< a text; false ends the connection
    std::function<void()> too_large;                                  ///< a message was
    std::function<void(const WebPeer&)> gone;                         ///< a WebSocket that was accepted is
};

class WebServer {
  public:
    /// Listens on the loopback address, or on all. Port 0: any free one. Throws InputError where it cannot.
    WebServer(int port, bool any_address, WebHandlers handlers, const WebLimits& limits = {});
    ~WebServer();
    int port() const;
    /// WebSockets now.
    int clients() const;
    /// To every client, in order; those who are behind miss some (skip_bytes), but never the last one.
    void send_text(const std::string& text);
    /// Texts that clients missed.
    std::int64_t missed() const;
    /// To every client that has read what it was sent before; others get the newest once they have. Takes the bytes,
    /// and gives back other memory.
    void send_newest(Bytes& binary);
    /// Ends all connections, once what waits for them is sent.
    void drop_clients();

  private:
    struct State;
    std::unique_ptr<State> state_;
};

}  // namespace palpate
