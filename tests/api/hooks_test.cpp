// What a host is told beside results: the log, and the offline report. libpalpate.so as its users see it.

#include <gtest/gtest.h>
#include <palpate/palpate.h>

#include <string>
#include <vector>

namespace {

struct Line {
    std::int32_t level;
    PalpateWorld world;
    std::string text;
};
void keep(const char* message, void* user) {
    Line line{-1, -1, message};
    EXPECT_EQ(PALPATE_OK, palpate_log_about(&line.level, &line.world));
    static_cast<std::vector<Line>*>(user)->push_back(line);
}

class Hooks : public ::testing::Test {
  protected:
    ~Hooks() override {
        palpate_set_log(nullptr, nullptr);
        palpate_destroy(world);
    }
    void load(const std::string& more, const std::string& settings = "newton_iterations = 20",
              const std::string& height = "6.5") {
        const std::string text =
            "dt_ms = 1\n[solver]\n" + settings +
            "\n[[object]]\nname = \"table\"\nkind = \"plane\"\n"
            "[[finger]]\nname = \"index\"\nelements = 120\ntrack = [ { t_s = 0, position_mm = [0, 0, " +
            height + "] } ]\n" + more;
        ASSERT_EQ(PALPATE_OK, palpate_load_text(text.c_str(), nullptr, &world)) << palpate_last_error();
    }
    std::string report() const {
        std::int64_t needed = 0;
        EXPECT_EQ(PALPATE_OK, palpate_get_text(world, PALPATE_TEXT_REPORT, 0, nullptr, 0, &needed))
            << palpate_last_error();
        std::string page(std::size_t(needed), '\0');
        EXPECT_EQ(PALPATE_OK, palpate_get_text(world, PALPATE_TEXT_REPORT, 0, page.data(), needed, nullptr));
        return page;
    }
    PalpateWorld world = 0;
    std::vector<Line> heard;
};

TEST_F(Hooks, TheLogIsToldOfScenesThatAreLikelyWrong) {
    palpate_set_log(keep, &heard);
    load("coupling = { stiffness_N_per_mm = 50000 }\n");
    ASSERT_FALSE(heard.empty());
    EXPECT_EQ(PALPATE_LOG_WARNING, heard[0].level);
    EXPECT_EQ(0, heard[0].world);
    EXPECT_NE(std::string::npos, heard[0].text.find("N/m")) << heard[0].text;
    std::int32_t level = 0;
    EXPECT_EQ(PALPATE_ERROR_STATE, palpate_log_about(&level, nullptr));
}

TEST_F(Hooks, TheLogIsToldOfStepsThatDidNotConverge) {
    load("", "newton_iterations = 1\ntolerance = 1e-12");
    palpate_set_log(keep, &heard);
    ASSERT_EQ(PALPATE_OK, palpate_step(world, 20));
    // The 1st, 2nd, 4th, 8th and 16th of those that the state of the finger says have not converged.
    PalpateFingerState felt;
    felt.size = sizeof felt;
    ASSERT_EQ(PALPATE_OK, palpate_get_finger(world, 0, &felt));
    ASSERT_EQ(0, felt.converged);
    ASSERT_EQ(5u, heard.size());
    for (const Line& line : heard) {
        EXPECT_EQ(PALPATE_LOG_WARNING, line.level);
        EXPECT_EQ(world, line.world);
        EXPECT_EQ(0u, line.text.find("index: step ")) << line.text;
    }
    EXPECT_NE(std::string::npos, heard[4].text.find("step 16 did not converge (16 of its steps")) << heard[4].text;
    palpate_set_log(nullptr, nullptr);
    ASSERT_EQ(PALPATE_OK, palpate_step(world, 20));
    EXPECT_EQ(5u, heard.size());
}

TEST_F(Hooks, TheLogHearsNothingWhereAllIsWell) {
    palpate_set_log(keep, &heard);
    load("", "preset = \"balanced\"", "10");
    ASSERT_EQ(PALPATE_OK, palpate_step(world, 50));
    for (const Line& line : heard) EXPECT_NE(PALPATE_LOG_WARNING, line.level) << line.text;
}

TEST_F(Hooks, TheReportShowsKeptFramesOrNow) {
    load("device = { kind = \"chinello-3rrs\" }\n");
    ASSERT_EQ(PALPATE_OK, palpate_step(world, 20));
    EXPECT_NE(std::string::npos, report().find("; 1 frames shown"));
    ASSERT_EQ(PALPATE_OK, palpate_keep_frames(world, 100));
    ASSERT_EQ(PALPATE_OK, palpate_step(world, 100));
    const std::string page = report();
    EXPECT_EQ(0u, page.find("<!DOCTYPE html>")) << page.substr(0, 100);
    EXPECT_NE(std::string::npos, page.find("0.12 s in steps of 1 ms, "));
    EXPECT_NE(std::string::npos, page.find(" % of them converged; 11 frames shown"));
    for (const char* from : {"src=\"http", "href=\"http"}) EXPECT_EQ(std::string::npos, page.find(from));  // no network
    ASSERT_EQ(PALPATE_OK, palpate_keep_frames(world, 0));
    EXPECT_NE(std::string::npos, report().find("; 1 frames shown"));
    EXPECT_EQ(PALPATE_ERROR_ARGUMENT, palpate_keep_frames(world, -1));
    EXPECT_NE(std::string(palpate_last_error()).find("0 (none) to 10000"), std::string::npos);
}

}  // namespace
