#pragma once
// A page in a real browser that is asked, pointed at and typed into, over the browser's own protocol (Chrome DevTools
// Protocol, by pipes): as a person would, and with the browser's account of what a screen reader is told.

#include <sys/types.h>

#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace palpate::testing {

/// How a page is looked at.
struct BrowserWindow {
    int width = 800, height = 600;
    bool dark = false;
    std::filesystem::path screenshot{};  ///< empty: none is made
};

class BrowserPage {
  public:
    BrowserPage();
    BrowserPage(const std::string& url, int width, int height);  ///< a page of palpate's, once it is ready
    ~BrowserPage();
    BrowserPage(const BrowserPage&) = delete;
    BrowserPage& operator=(const BrowserPage&) = delete;
    /// Goes to a page, and returns when it has loaded and its scripts have run.
    void open(const std::string& url, const BrowserWindow& window);
    /// A method of the protocol; its result. Throws std::runtime_error on an error, or where the browser is gone.
    nlohmann::json call(const std::string& method, const nlohmann::json& parameters = nlohmann::json::object());
    /// What a script comes to; of a promise, what it is kept with.
    nlohmann::json run(const std::string& script);
    void move_to(double x, double y);
    void click(double x, double y);
    void press(const std::string& key, const std::string& code = "");
    /// Waits until the console has said a word, or an error ("Uncaught"); returns which, or all it has said since the
    /// page was opened where neither comes in time.
    std::string heard(const std::string& word, double seconds);
    /// Processor time of the browser so far [s].
    double processor_s() const;

  private:
    nlohmann::json read(int timeout_ms);
    void keep_what_is_said(const nlohmann::json& event);
    pid_t process_ = 0;
    int to_ = -1, from_ = -1, number_ = 0;
    std::string session_, waiting_;
    std::vector<std::string> said_;  ///< by the console
    std::filesystem::path profile_;
};

}  // namespace palpate::testing
