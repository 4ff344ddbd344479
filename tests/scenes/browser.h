#pragma once
// Pages in a real browser, where one is installed (Debian package chromium), and tables to compare them with.

#include <filesystem>
#include <map>
#include <string>

#include "tests/scenes/browser_page.h"

namespace palpate::testing {

bool browser_is_installed();
/// Where screenshots are kept for whoever wants to see them: a folder beside the tests' program, which is made.
std::filesystem::path screenshots();

/// The body's tag, with its attributes, as it stands when the page's scripts have run. One browser serves all calls of
/// a process: to start one, and to have it compile the page's shaders, takes three times as long as to show the page.
std::string page_of(const std::string& url, const BrowserWindow& window = {});
/// Opens a page and waits until its console has said a word, or an error; returns which, or all it has said where it
/// does not come. There is no time but the clock's: a browser that draws in software on busy cores takes long.
std::string what_a_browser_says(const std::string& url, const std::string& word);
/// The value of an attribute of the page's body; empty if it has none.
std::string attribute(const std::string& page, const std::string& name);

/// A column of a table by time [ms].
std::map<int, double> column_by_ms(const std::string& file, const std::string& name);

}  // namespace palpate::testing
