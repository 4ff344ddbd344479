#include "tests/scenes/browser.h"

#include <signal.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <sstream>

namespace palpate::testing {

namespace {
const std::string chromium =
    " chromium --headless --no-sandbox --use-gl=angle --use-angle=swiftshader --enable-unsafe-swiftshader ";
}  // namespace

bool browser_is_installed() { return std::system("command -v chromium > /dev/null 2>&1") == 0; }

std::string page_of(const std::string& url, const BrowserWindow& window) {
    // A profile of its own: browsers that share one wait for each other.
    std::string command = "profile=$(mktemp -d); timeout -s KILL $seconds" + chromium +
                          "--user-data-dir=\"$profile\" --dump-dom --window-size=" + std::to_string(window.width) +
                          "," + std::to_string(window.height);
    if (window.dark) command += " --force-dark-mode";
    if (!window.screenshot.empty()) command += " --screenshot=" + window.screenshot.string();
    command += " '" + url + "' 2>/dev/null; rm -rf \"$profile\"";
    std::string out;
    for (int turn = 0; turn < 4 && out.empty(); ++turn) {  // on a busy machine some never end
        FILE* pipe = popen(("seconds=" + std::to_string(40 << turn) + "; " + command).c_str(), "r");
        char buffer[65536];
        for (std::size_t n; (n = fread(buffer, 1, sizeof buffer, pipe)) > 0;) out.append(buffer, n);
        pclose(pipe);
    }
    return out;
}

std::string what_a_browser_says(const std::string& url, const std::string& word) {
    const std::string command = "echo $$; exec timeout -s KILL 200" + chromium +
                                "--window-size=800,600 --enable-logging=stderr '" + url + "' 2>&1";
    FILE* pipe = popen(command.c_str(), "r");
    std::string said, found;
    char line[4096] = "";
    const int process = fgets(line, sizeof line, pipe) ? std::atoi(line) : 0;
    while (found.empty() && fgets(line, sizeof line, pipe)) {
        said += line;
        for (const std::string& mark : {word, std::string("Uncaught")})
            if (std::strstr(line, "CONSOLE") && std::strstr(line, mark.c_str())) found = mark;
    }
    if (process > 0) kill(process, SIGTERM);
    pclose(pipe);
    return found.empty() ? said : found;
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
