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
[[noreturn]] void become_browser(int asked, int answers, const std::string& profile) {
    setpgid(0, 0);
    const int a = fcntl(asked, F_DUPFD, 10), b = fcntl(answers, F_DUPFD, 10), nothing = open("/dev/null", O_RDWR);
    dup2(a, 3), dup2(b, 4);
    for (const int standard : {0, 1, 2}) dup2(nothing, standard);
    execlp("chromium", "chromium", "--headless", "--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader",
           "--enable-unsafe-swiftshader", "--remote-debugging-pipe", profile.c_str(), "about:blank", nullptr);
    _exit(127);
}

std::string from_base64(const std::string& coded) {
    const std::string digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    std::string out;
    unsigned bits = 0, held = 0;
    for (const char c : coded) {
        const std::size_t digit = digits.find(c);
        if (digit == std::string::npos) break;  // "=" fills the end
        bits = bits << 6 | unsigned(digit), held += 6;
        if (held >= 8) held -= 8, out += char(bits >> held & 255);
    }
    return out;
}

}  // namespace

BrowserPage::BrowserPage() {
    char folder[] = "/tmp/palpate-browser-XXXXXX";
    if (!mkdtemp(folder)) throw std::runtime_error("no folder for a browser's profile");
    profile_ = folder;
    std::array<int, 2> asked{}, answers{};
    if (pipe2(asked.data(), O_CLOEXEC) != 0 || pipe2(answers.data(), O_CLOEXEC) != 0)
        throw std::runtime_error("no pipes");
    const std::string profile = "--user-data-dir=" + profile_.string();
    process_ = fork();
    if (process_ == 0) become_browser(asked[0], answers[1], profile);
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
    call("Runtime.enable");
}

BrowserPage::BrowserPage(const std::string& url, int width, int height) : BrowserPage() {
    open(url, {width, height});
    for (int turn = 0; turn < 600; ++turn) {
        if (run("document.body.dataset.ready || ''") == "1") return;
        std::this_thread::sleep_for(std::chrono::milliseconds(100));
    }
    throw std::runtime_error("the page is not ready after a minute");
}

void BrowserPage::open(const std::string& url, const BrowserWindow& window) {
    call("Page.navigate", {{"url", "about:blank"}});  // to the same page with another #, it would only scroll
    while (run("location.href") != "about:blank") std::this_thread::sleep_for(std::chrono::milliseconds(20));
    call("Emulation.setDeviceMetricsOverride",
         {{"width", window.width}, {"height", window.height}, {"deviceScaleFactor", 1}, {"mobile", false}});
    call("Emulation.setEmulatedMedia",
         {{"features", {{{"name", "prefers-color-scheme"}, {"value", window.dark ? "dark" : "light"}}}}});
    said_.clear();
    call("Page.navigate", {{"url", url}});
    const auto begun = std::chrono::steady_clock::now();
    while (run("location.href !== 'about:blank' && document.readyState") != "complete") {
        if (std::chrono::steady_clock::now() - begun > std::chrono::minutes(3))
            throw std::runtime_error("the page is not loaded after three minutes");
        std::this_thread::sleep_for(std::chrono::milliseconds(50));
    }
    if (window.screenshot.empty()) return;
    const std::string coded = call("Page.captureScreenshot")["data"];
    std::ofstream file(window.screenshot, std::ios::binary);
    file << from_base64(coded);
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

/// What the browser says next; null where nothing comes in time.
nlohmann::json BrowserPage::read(int timeout_ms) {
    std::size_t end;
    while ((end = waiting_.find('\0')) == std::string::npos) {
        pollfd p{from_, POLLIN, 0};
        char buffer[65536];
        if (poll(&p, 1, timeout_ms) <= 0) return {};
        const ssize_t n = ::read(from_, buffer, sizeof buffer);
        if (n <= 0) throw std::runtime_error("the browser is gone");
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
        const nlohmann::json answer = read(120'000);
        if (answer.is_null()) throw std::runtime_error("the browser does not answer");
        if (answer.value("id", 0) != number_) {  // it tells of something
            keep_what_is_said(answer);
            continue;
        }
        if (answer.contains("error")) throw std::runtime_error(method + ": " + answer["error"].dump());
        return answer["result"];
    }
}

void BrowserPage::keep_what_is_said(const nlohmann::json& event) {
    if (event.is_null()) return;
    const std::string method = event.value("method", "");
    if (method == "Runtime.exceptionThrown") said_.push_back(event["params"]["exceptionDetails"].dump());
    if (method != "Runtime.consoleAPICalled") return;
    std::string text;
    for (const auto& part : event["params"]["args"]) text += part.contains("value") ? part["value"].dump() : "";
    said_.push_back(text);
}

std::string BrowserPage::heard(const std::string& word, double seconds) {
    const auto until = std::chrono::steady_clock::now() + std::chrono::duration<double>(seconds);
    std::size_t looked_at = 0;
    while (true) {
        for (; looked_at < said_.size(); ++looked_at)
            for (const std::string& mark : {word, std::string("Uncaught")})
                if (said_[looked_at].find(mark) != std::string::npos) return mark;
        if (std::chrono::steady_clock::now() > until) break;
        keep_what_is_said(read(1000));
    }
    std::string all;
    for (const std::string& text : said_) all += text + "\n";
    return all;
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
