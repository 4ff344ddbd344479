#pragma once
// A page in a real browser that is asked, pointed at and typed into, over the browser's own protocol (Chrome DevTools
// Protocol, by pipes): as a person would, and with the browser's account of what a screen reader is told.

#include <sys/types.h>

#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>

namespace palpate::testing {

class BrowserPage {
  public:
    BrowserPage(const std::string& url, int width, int height);
    ~BrowserPage();
    BrowserPage(const BrowserPage&) = delete;
    BrowserPage& operator=(const BrowserPage&) = delete;
    /// A method of the protocol; its result. Throws std::runtime_error on an error, or where the browser is gone.
    nlohmann::json call(const std::string& method, const nlohmann::json& parameters = nlohmann::json::object());
    /// What a script comes to; of a promise, what it is kept with.
    nlohmann::json run(const std::string& script);
    void move_to(double x, double y);
    void click(double x, double y);
    void press(const std::string& key, const std::string& code = "");
    /// Processor time of the browser so far [s].
    double processor_s() const;

  private:
    nlohmann::json read();
    pid_t process_ = 0;
    int to_ = -1, from_ = -1, number_ = 0;
    std::string session_, waiting_;
    std::filesystem::path profile_;
};

}  // namespace palpate::testing
