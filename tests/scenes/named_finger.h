#pragma once
// Fingers by name, built and pressed.

#include <gtest/gtest.h>

#include "scenes/load/finger_model.h"
#include "scenes/load/section.h"
#include "scenes/studies/indentation.h"

namespace palpate::testing {

inline FingerModel named(const std::string& name) {
    FingerModel m;
    Problems problems;
    read_named_finger(name, "", m, problems);
    EXPECT_TRUE(problems.messages.empty()) << problems.messages.front();
    return m;
}

inline FingerSpec built(const FingerModel& m) {
    static FingerTemplates templates;
    std::string note;
    return build_finger(m, templates, note);
}

inline std::vector<IndentationCurve> pressed(const std::vector<Indentation>& fingers,
                                             IndentationSettings s = {.steps = 12}) {
    Threads threads(2);
    return indent(fingers, s, threads);
}

inline constexpr double degree = 3.14159265358979 / 180;

}  // namespace palpate::testing
