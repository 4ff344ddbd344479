#include "scenes/viewer/server.h"

#include <mutex>
#include <nlohmann/json.hpp>

#include "meshes/input_error.h"
#include "scenes/web/access.h"
#include "scenes/web/bounded_json.h"
#include "scenes/web/server.h"

namespace palpate {

namespace {
constexpr std::size_t most_commands = 64;
constexpr JsonBounds command_bounds{4096, 8};
}  // namespace

struct ViewServer::State {
    std::string token = random_token();
    bool any_address = false;
    std::mutex page_mutex, command_mutex, standing_mutex;
    std::string page;
    nlohmann::json standing = nlohmann::json::object();  ///< what newcomers are told
    std::vector<ViewCommand> commands;
    std::unique_ptr<WebServer> web;  ///< ends first

    bool knows_token(const HttpHead& head) const { return same_token(query_value(head.query(), "token"), token); }

    /// A page of another site must not steer the simulation of whoever visits it: the browser tells where a page is
    /// from.
    bool is_own_page(const HttpHead& head) const {
        const std::string origin = head.field("origin");
        return origin.empty() || (origin == "http://" + head.field("host") && (any_address || is_local_origin(origin)));
    }

    WebReply reply(const HttpHead& head) {
        const std::string path = head.path(), plain = "text/plain; charset=utf-8";
        if (path != "/") return {"404 Not Found", plain, "not found\n"};
        if (!knows_token(head))
            return {"403 Forbidden", plain,
                    "Open the whole address that palpate view has printed: its token is missing here, or old.\n"};
        const std::lock_guard lock(page_mutex);
        return {"200 OK", "text/html; charset=utf-8", page};
    }

    bool take(const WebPeer& peer, const std::string& text) {
        std::string wrong;
        nlohmann::json what = parse_object(text, wrong, command_bounds);
        if (!wrong.empty()) return true;
        const std::lock_guard lock(command_mutex);
        if (commands.size() < most_commands) commands.push_back({std::move(what), peer.local});
        return true;
    }
};

ViewServer::ViewServer(int port, bool any_address) : state_(std::make_unique<State>()) {
    State& s = *state_;
    s.any_address = any_address;
    WebHandlers handlers;
    handlers.page = [&s](const HttpHead& head) { return s.reply(head); };
    handlers.accepts = [&s](const HttpHead& head, const WebPeer&) {
        return head.path() == "/frames" && s.knows_token(head) && s.is_own_page(head);
    };
    handlers.greeting = [&s] {
        const std::lock_guard lock(s.standing_mutex);
        return s.standing.empty() ? std::string() : s.standing.dump();
    };
    handlers.message = [&s](const WebPeer& peer, const std::string& text) { return s.take(peer, text); };
    WebLimits limits;
    limits.message_bytes = command_bounds.size;
    try {
        s.web = std::make_unique<WebServer>(port, any_address, std::move(handlers), limits);
    } catch (const InputError& error) {
        throw InputError("the viewer " + error.messages.front() + " Choose one with --port");
    }
}

ViewServer::~ViewServer() = default;

int ViewServer::port() const { return state_->web->port(); }

const std::string& ViewServer::token() const { return state_->token; }

std::string ViewServer::url() const {
    return "http://127.0.0.1:" + std::to_string(port()) + "/?token=" + state_->token;
}

void ViewServer::set_page(std::string page) {
    bool replaced = false;
    {
        const std::lock_guard lock(state_->page_mutex);
        replaced = !state_->page.empty() && state_->page != page;
        state_->page = std::move(page);
    }
    if (replaced) tell({{"reload", true}});
}

void ViewServer::publish(std::vector<std::uint8_t>& frame) { state_->web->send_newest(frame); }

void ViewServer::tell(const nlohmann::json& message) { state_->web->send_text(message.dump()); }

void ViewServer::tell_all(const nlohmann::json& message) {
    {
        const std::lock_guard lock(state_->standing_mutex);
        state_->standing.update(message);
    }
    tell(message);
}

std::vector<ViewCommand> ViewServer::take_commands() {
    const std::lock_guard lock(state_->command_mutex);
    return std::exchange(state_->commands, {});
}

}  // namespace palpate
