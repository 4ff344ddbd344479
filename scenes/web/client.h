#pragma once
// The other end of a WebSocket: a client that can be told to stop at any moment.

#include <functional>
#include <string>
#include <vector>

namespace palpate {

struct WebConversation {
    std::string host, path = "/";
    int port = 0;
    std::size_t message_bytes = 65536;                    ///< of a message; a longer one ends the connection
    double connect_s = 2;                                 ///< to connect, and again to shake hands
    std::function<std::vector<std::string>()> connected;  ///< returns what to send at first
    std::function<void(const std::string&)> message;      ///< a text has come
    std::function<void()> too_large;                      ///< a message was
};

/// Connects to ws://HOST:PORT/PATH and talks until the other end closes, or `stop_fd` becomes readable, which ends
/// everything at once. Messages go to `conversation.message`, in this thread. Returns why it ended.
std::string converse(const WebConversation& conversation, int stop_fd);

}  // namespace palpate
