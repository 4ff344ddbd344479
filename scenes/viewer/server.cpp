#include "scenes/viewer/server.h"

#include <civetweb.h>

#include <algorithm>
#include <condition_variable>
#include <mutex>
#include <thread>

#include "meshes/input_error.h"

namespace palpate {

namespace {
constexpr std::size_t most_clients = 8, most_commands = 64, largest_message = 4096;
}

struct ViewServer::State {
    mg_context* context = nullptr;
    int port = 0;
    bool any_address = false;
    std::mutex page_mutex, clients_mutex, frame_mutex, command_mutex;
    std::string page;
    std::vector<mg_connection*> clients;
    std::vector<std::uint8_t> newest, sending;
    std::vector<std::string> texts;  ///< to be sent before the newest frame
    bool fresh = false, ending = false;
    std::condition_variable arrived;
    std::vector<nlohmann::json> commands;
    std::thread sender;

    void send_frames() {
        std::unique_lock lock(frame_mutex);
        while (true) {
            arrived.wait(lock, [&] { return fresh || ending || !texts.empty(); });
            if (ending) return;
            const std::vector<std::string> messages = std::exchange(texts, {});
            const bool frame = std::exchange(fresh, false);
            if (frame) std::swap(newest, sending);
            lock.unlock();
            for (const auto& text : messages) write(MG_WEBSOCKET_OPCODE_TEXT, text.data(), text.size());
            if (frame) write(MG_WEBSOCKET_OPCODE_BINARY, reinterpret_cast<const char*>(sending.data()), sending.size());
            lock.lock();
        }
    }
    void write(int kind, const char* data, std::size_t size) {
        const std::lock_guard lock(clients_mutex);
        for (mg_connection* c : clients) mg_websocket_write(c, kind, data, size);
    }
    /// A page of another site must not steer the simulation of whoever visits it.
    bool trusted(const mg_connection* c) const {
        const char* origin = mg_get_header(c, "Origin");
        if (!origin || any_address) return true;
        const std::string suffix = std::string(":").append(std::to_string(port)), o = origin;
        return o == "http://127.0.0.1" + suffix || o == "http://localhost" + suffix || o == "http://[::1]" + suffix;
    }
    static State& of(void* data) { return *static_cast<State*>(data); }
};

namespace {

int send_page(mg_connection* c, const std::string& page, const char* status) {
    mg_printf(
        c,
        "HTTP/1.1 %s\r\nContent-Type: text/html; charset=utf-8\r\nContent-Length: %zu\r\nCache-Control: no-store\r\n"
        "Connection: close\r\n\r\n",
        status, page.size());
    mg_write(c, page.data(), page.size());
    return 1;
}

}  // namespace

ViewServer::ViewServer(int port, bool any_address) : state_(std::make_unique<State>()) {
    State& s = *state_;
    s.any_address = any_address;
    const std::string address = std::string(any_address ? "" : "127.0.0.1:").append(std::to_string(port));
    const char* options[] = {"listening_ports",      address.c_str(), "num_threads", "12", "request_timeout_ms", "5000",
                             "websocket_timeout_ms", "3600000",       nullptr};
    mg_init_library(MG_FEATURES_WEBSOCKET);
    mg_callbacks callbacks{};
    s.context = mg_start(&callbacks, &s, options);
    if (!s.context)
        throw InputError("the viewer cannot listen on port " + std::to_string(port) +
                         ": is another program using it? Choose one with --port");
    mg_server_port listening[4];
    if (mg_get_server_ports(s.context, 4, listening) > 0) s.port = listening[0].port;
    mg_set_request_handler(
        s.context, "/",
        [](mg_connection* c, void* data) {
            State& state = State::of(data);
            if (std::string(mg_get_request_info(c)->local_uri) != "/")
                return send_page(c, "not found\n", "404 Not Found");
            std::string page;
            {
                const std::lock_guard lock(state.page_mutex);
                page = state.page;
            }
            return send_page(c, page, "200 OK");
        },
        &s);
    mg_set_websocket_handler(
        s.context, "/frames",
        [](const mg_connection* c, void* data) -> int {
            State& state = State::of(data);
            const std::lock_guard lock(state.clients_mutex);
            return state.trusted(c) && state.clients.size() < most_clients ? 0 : 1;
        },
        [](mg_connection* c, void* data) {
            State& state = State::of(data);
            const std::lock_guard lock(state.clients_mutex);
            state.clients.push_back(c);
        },
        [](mg_connection*, int kind, char* text, std::size_t size, void* data) -> int {
            if ((kind & 0xf) == MG_WEBSOCKET_OPCODE_CONNECTION_CLOSE) return 0;
            if ((kind & 0xf) != MG_WEBSOCKET_OPCODE_TEXT) return 1;
            if (size > largest_message) return 0;
            auto command = nlohmann::json::parse(text, text + size, nullptr, false);
            if (!command.is_object()) return 1;
            State& state = State::of(data);
            const std::lock_guard lock(state.command_mutex);
            if (state.commands.size() < most_commands) state.commands.push_back(std::move(command));
            return 1;
        },
        [](const mg_connection* c, void* data) {
            State& state = State::of(data);
            const std::lock_guard lock(state.clients_mutex);
            state.clients.erase(std::remove(state.clients.begin(), state.clients.end(), c), state.clients.end());
        },
        &s);
    s.sender = std::thread([&s] { s.send_frames(); });
}

ViewServer::~ViewServer() {
    {
        const std::lock_guard lock(state_->frame_mutex);
        state_->ending = true;
    }
    state_->arrived.notify_all();
    state_->sender.join();
    mg_stop(state_->context);
    mg_exit_library();
}

int ViewServer::port() const { return state_->port; }

void ViewServer::set_page(std::string page) {
    bool replaced = false;
    {
        const std::lock_guard lock(state_->page_mutex);
        replaced = !state_->page.empty() && state_->page != page;
        state_->page = std::move(page);
    }
    if (replaced) tell({{"reload", true}});
}

void ViewServer::publish(std::vector<std::uint8_t>& frame) {
    {
        const std::lock_guard lock(state_->frame_mutex);
        std::swap(state_->newest, frame);
        state_->fresh = true;
    }
    state_->arrived.notify_one();
}

void ViewServer::tell(const nlohmann::json& message) {
    {
        const std::lock_guard lock(state_->frame_mutex);
        if (state_->texts.size() < most_commands) state_->texts.push_back(message.dump());
    }
    state_->arrived.notify_one();
}

std::vector<nlohmann::json> ViewServer::take_commands() {
    const std::lock_guard lock(state_->command_mutex);
    return std::exchange(state_->commands, {});
}

}  // namespace palpate
