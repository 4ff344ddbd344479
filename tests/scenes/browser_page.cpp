#include "tests/scenes/browser_page.h"

#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <cstdlib>
#include <fstream>
#include <sstream>
#include <stdexcept>
#include <thread>

namespace palpate::testing {

namespace {

/// Becomes a browser that reads what it is asked on 3 and answers on 4.
[[noreturn]] void become_browser(int asked, int answers, const std::string& profile, const std::string& size) {
    setpgid(0, 0);
    const int a = fcntl(asked, F_DUPFD, 10), b = fcntl(answers, F_DUPFD, 10), nothing = open("/dev/null", O_RDWR);
    dup2(a, 3), dup2(b, 4);
    for (const int standard : {0, 1, 2}) dup2(nothing, standard);
    execlp("chromium", "chromium", "--headless", "--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader",
           "--enable-unsafe-swiftshader", "--remote-debugging-pipe", profile.c_str(), size.c_str(), "about:blank",
           nullptr);
    _exit(127);
}

}  // namespace

BrowserPage::BrowserPage(const std::string& url, int width, int height) {
    char folder[] = "/tmp/palpate-browser-XXXXXX";
    if (!mkdtemp(folder)) throw std::runtime_error("no folder for a browser's profile");
    profile_ = folder;
    std::array<int, 2> asked{}, answers{};
    if (pipe2(asked.data(), O_CLOEXEC) != 0 || pipe2(answers.data(), O_CLOEXEC) != 0)
        throw std::runtime_error("no pipes");
    const std::string profile = "--user-data-dir=" + profile_.string(),
                      size = "--window-size=" + std::to_string(width) + "," + std::to_string(height);
    process_ = fork();
    if (process_ == 0) become_browser(asked[0], answers[1], profile, size);
    close(asked[0]), close(answers[1]);
    to_ = asked[1], from_ = answers[0];
    std::string target;
    while (target.empty()) {
        const nlohmann::json targets = call("Target.getTargets");
        for (const auto& t : targets["targetInfos"])
            if (t["type"] == "page" && target.empty()) target = t["targetId"];
    }
    session_ = call("Target.attachToTarget", {{"targetId", target}, {"flatten", true}})["sessionId"];
    call("Page.enable");
    call("Emulation.setDeviceMetricsOverride",
         {{"width", width}, {"height", height}, {"deviceScaleFactor", 1}, {"mobile", false}});
    call("Page.navigate", {{"url", url}});
    for (int turn = 0; turn < 600; ++turn) {
        if (run("document.body ? document.body.dataset.ready || '' : ''") == "1") return;
        std::this_thread::sleep_for(std::chrono::milliseconds(100));
    }
    throw std::runtime_error("the page is not ready after a minute");
}

BrowserPage::~BrowserPage() {
    if (process_ > 0) kill(-process_, SIGKILL), waitpid(process_, nullptr, 0);
    close(to_), close(from_);
    std::error_code error;
    for (int turn = 0; turn < 20 && std::filesystem::exists(profile_); ++turn) {  // its children end a little later
        std::filesystem::remove_all(profile_, error);
        if (error) std::this_thread::sleep_for(std::chrono::milliseconds(50));
    }
}

nlohmann::json BrowserPage::read() {
    std::size_t end;
    while ((end = waiting_.find('\0')) == std::string::npos) {
        pollfd p{from_, POLLIN, 0};
        char buffer[65536];
        const ssize_t n = poll(&p, 1, 120000) > 0 ? ::read(from_, buffer, sizeof buffer) : 0;
        if (n <= 0) throw std::runtime_error("the browser does not answer");
        waiting_.append(buffer, std::size_t(n));
    }
    nlohmann::json message = nlohmann::json::parse(waiting_.substr(0, end));
    waiting_.erase(0, end + 1);
    return message;
}

nlohmann::json BrowserPage::call(const std::string& method, const nlohmann::json& parameters) {
    nlohmann::json message{{"id", ++number_}, {"method", method}, {"params", parameters}};
    if (!session_.empty()) message["sessionId"] = session_;
    std::string text = message.dump();
    text += '\0';
    for (std::size_t at = 0; at < text.size();) {
        const ssize_t n = write(to_, text.data() + at, text.size() - at);
        if (n <= 0) throw std::runtime_error("the browser is gone");
        at += std::size_t(n);
    }
    while (true) {
        const nlohmann::json answer = read();
        if (answer.value("id", 0) != number_) continue;  // it tells of something
        if (answer.contains("error")) throw std::runtime_error(method + ": " + answer["error"].dump());
        return answer["result"];
    }
}

nlohmann::json BrowserPage::run(const std::string& script) {
    const nlohmann::json answer =
        call("Runtime.evaluate", {{"expression", script}, {"returnByValue", true}, {"awaitPromise", true}});
    if (answer.contains("exceptionDetails"))
        throw std::runtime_error(script + ": " + answer["exceptionDetails"].dump());
    return answer["result"].value("value", nlohmann::json());
}

void BrowserPage::move_to(double x, double y) {
    call("Input.dispatchMouseEvent", {{"type", "mouseMoved"}, {"x", x}, {"y", y}});
}

void BrowserPage::click(double x, double y) {
    move_to(x, y);
    for (const char* type : {"mousePressed", "mouseReleased"})
        call("Input.dispatchMouseEvent", {{"type", type}, {"x", x}, {"y", y}, {"button", "left"}, {"clickCount", 1}});
}

void BrowserPage::press(const std::string& key, const std::string& code) {
    const int number = key == "Tab" ? 9 : key == "Escape" ? 27 : key == " " ? 32 : key == "Enter" ? 13 : 0;
    nlohmann::json down{{"type", "keyDown"}, {"key", key}, {"code", code}, {"windowsVirtualKeyCode", number}};
    if (key.size() == 1) down["text"] = key;
    call("Input.dispatchKeyEvent", down);
    down["type"] = "keyUp", down.erase("text");
    call("Input.dispatchKeyEvent", down);
}

double BrowserPage::processor_s() const {
    double ticks = 0;
    for (const auto& entry : std::filesystem::directory_iterator("/proc")) {
        std::ifstream file(entry.path() / "stat");
        std::string text;
        std::getline(file, text);
        const std::size_t name = text.rfind(')');  // names may hold anything
        if (name == std::string::npos) continue;
        std::istringstream rest(text.substr(name + 2));
        std::string field;
        long group = 0, user = 0, system = 0;
        for (int k = 3; k <= 15 && rest >> field; ++k) {
            if (k == 5) group = std::atol(field.c_str());
            if (k == 14) user = std::atol(field.c_str());
            if (k == 15) system = std::atol(field.c_str());
        }
        if (group == process_) ticks += double(user + system);
    }
    return ticks / double(sysconf(_SC_CLK_TCK));
}

}  // namespace palpate::testing
