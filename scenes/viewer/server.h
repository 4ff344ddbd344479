#pragma once
// The live viewer's server: its page over HTTP, frames and commands over a WebSocket.

#include <cstdint>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace palpate {

/// Listens on the loopback address unless `any_address`. Nothing here waits for a client: a slow one gets the newest
/// frame when it is ready for one.
class ViewServer {
  public:
    /// Port 0: any free one. Throws InputError where it cannot listen.
    ViewServer(int port, bool any_address);
    ~ViewServer();
    int port() const;
    /// The page from now on; clients that show another one are told to load it.
    void set_page(std::string page);
    /// Takes the newest frame and gives back an old one's memory.
    void publish(std::vector<std::uint8_t>& frame);
    /// Sends a text to every client.
    void tell(const nlohmann::json& message);
    /// What clients have asked for since the last call: objects, at most 4 kB each. Others were dropped.
    std::vector<nlohmann::json> take_commands();

  private:
    struct State;
    std::unique_ptr<State> state_;
};

}  // namespace palpate
