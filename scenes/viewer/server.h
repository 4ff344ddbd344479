#pragma once
// The live viewer's server: its page over HTTP, frames and commands over a WebSocket.

#include <cstdint>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace palpate {

/// What a page has asked for: an object of at most 4 kB.
struct ViewCommand {
    nlohmann::json what;
    bool local = false;  ///< from a browser on this machine
};

/// Listens on the loopback address unless `any_address`. Who knows the token sees the page and steers; others are
/// refused, and so are pages of other sites. Nothing here waits for a client: a slow one gets the newest frame when it
/// is ready for one.
class ViewServer {
  public:
    /// Port 0: any free one. Throws InputError where it cannot listen.
    ViewServer(int port, bool any_address);
    ~ViewServer();
    int port() const;
    /// Made anew for every server.
    const std::string& token() const;
    /// The address of the page, token included.
    std::string url() const;
    /// The page from now on; clients that show another one are told to load it.
    void set_page(std::string page);
    /// Takes the newest frame and gives back an old one's memory.
    void publish(std::vector<std::uint8_t>& frame);
    /// Sends a text to every client.
    void tell(const nlohmann::json& message);
    /// The same, and to whoever comes later: what holds until it is told anew.
    void tell_all(const nlohmann::json& message);
    /// What clients have asked for since the last call. What is no object, or beyond 4 kB, was dropped.
    std::vector<ViewCommand> take_commands();

  private:
    struct State;
    std::unique_ptr<State> state_;
};

}  // namespace palpate
