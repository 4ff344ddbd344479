#include "tests/scenes/browser.h"

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <fstream>
#include <memory>
#include <sstream>

namespace palpate::testing {

bool browser_is_installed() { return std::system("command -v chromium > /dev/null 2>&1") == 0; }

std::filesystem::path screenshots() {
    const auto folder = std::filesystem::read_symlink("/proc/self/exe").parent_path() / "screenshots";
    std::filesystem::create_directories(folder);
    return folder;
}

namespace {
/// Does something in the browser of this process; on a busy machine one may hang, and then another one is asked.
template <class Work>
std::string in_browser(const Work& work) {
    static std::unique_ptr<BrowserPage> browser;
    for (int turn = 0; turn < 3; ++turn) {
        try {
            if (!browser) browser = std::make_unique<BrowserPage>();
            return work(*browser);
        } catch (const std::exception& e) {
            std::fprintf(stderr, "browser: %s\n", e.what());
            browser.reset();
        }
    }
    return "";
}
}  // namespace

std::string page_of(const std::string& url, const BrowserWindow& window) {
    return in_browser([&](BrowserPage& page) {
        page.open(url, window);
        return page.run("document.body.cloneNode(false).outerHTML").get<std::string>();
    });
}

std::string what_a_browser_says(const std::string& url, const std::string& word) {
    return in_browser([&](BrowserPage& page) {
        page.open(url, {800, 600});
        const std::string heard = page.heard(word, 200);
        page.call("Page.navigate", {{"url", "about:blank"}});
        return heard;
    });
}

std::string attribute(const std::string& page, const std::string& name) {
    const std::string mark = name + "=\"";
    const std::size_t body = page.find("<body"), at = page.find(mark, body);
    if (body == std::string::npos || at == std::string::npos || at > page.find('>', body)) return "";
    return page.substr(at + mark.size(), page.find('"', at + mark.size()) - at - mark.size());
}

std::map<int, double> column_by_ms(const std::string& file, const std::string& name) {
    std::ifstream table(file);
    std::string line, cell;
    std::getline(table, line);
    std::istringstream head(line);
    int wanted = 0;
    while (std::getline(head, cell, ',') && cell != name) ++wanted;
    std::map<int, double> out;
    while (std::getline(table, line)) {
        std::istringstream row(line);
        std::getline(row, cell, ',');
        const int ms = int(std::lround(1e3 * std::stod(cell)));
        for (int k = 0; k < wanted; ++k) std::getline(row, cell, ',');
        out[ms] = std::atof(cell.c_str());
    }
    return out;
}

}  // namespace palpate::testing
