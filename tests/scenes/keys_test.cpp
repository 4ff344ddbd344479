// Keys: the loader's declarations are the only ones. KEYS.md, schema and loader agree, and nothing is missing or stale.

#include <toml++/toml.h>
#include <fstream>
#include <functional>
#include <nlohmann/json.hpp>
#include <sstream>

#include "meshes/input_error.h"
#include "scenes/load/key_reference.h"
#include "scenes/load/scene.h"
#include "tests/support.h"

namespace palpate {
namespace {

using Json = nlohmann::ordered_json;
using Type = KeyInfo::Type;

std::string contents(const std::filesystem::path& file) {
    std::ostringstream out;
    out << std::ifstream(file).rdbuf();
    return out.str();
}

std::vector<std::filesystem::path> toml_files(const std::filesystem::path& folder) {
    std::vector<std::filesystem::path> files;
    for (const auto& entry : std::filesystem::directory_iterator(folder))
        if (entry.path().extension() == ".toml") files.push_back(entry.path());
    return files;
}

void for_each_key(const KeyInfo& table, const std::string& path,
                  const std::function<void(const KeyInfo&, const std::string&)>& visit) {
    for (const KeyInfo& k : table.keys) {
        visit(k, path + k.name);
        for_each_key(k, path + k.name + ".", visit);
    }
}

/// As much of JSON schema (draft-07) as the schema uses. Adds what is wrong.
void check(const Json& schema, const Json& value, const std::string& path, std::vector<std::string>& wrong) {
    static const std::vector<std::string> understood{
        "$schema",    "title",    "description", "type",    "additionalProperties",
        "properties", "required", "minimum",     "maximum", "minItems",
        "maxItems",   "items",    "enum",        "default"};
    for (const auto& [word, _] : schema.items())
        if (std::find(understood.begin(), understood.end(), word) == understood.end())
            wrong.push_back("this test does not know the schema's '" + word + "'");
    auto fail = [&](const std::string& what) { wrong.push_back(path + ": " + what); };
    if (schema.contains("enum")) {
        if (std::find(schema["enum"].begin(), schema["enum"].end(), value) == schema["enum"].end()) fail("not a word");
        return;
    }
    const std::string type = schema.at("type");
    const bool right = type == "number"    ? value.is_number()
                       : type == "integer" ? value.is_number_integer()
                       : type == "boolean" ? value.is_boolean()
                       : type == "string"  ? value.is_string()
                       : type == "array"   ? value.is_array()
                                           : value.is_object();
    if (!right) return fail("not a " + type);
    if (schema.contains("minimum") && value.get<double>() < schema["minimum"].get<double>()) fail("too small");
    if (schema.contains("maximum") && value.get<double>() > schema["maximum"].get<double>()) fail("too large");
    if (schema.contains("minItems") && value.size() < schema["minItems"].get<std::size_t>()) fail("too few");
    if (schema.contains("maxItems") && value.size() > schema["maxItems"].get<std::size_t>()) fail("too many");
    if (schema.contains("items"))
        for (const auto& item : value) check(schema["items"], item, path + "[]", wrong);
    if (schema.contains("properties"))
        for (const auto& [key, item] : value.items()) {
            if (schema["properties"].contains(key))
                check(schema["properties"][key], item, path + "." + key, wrong);
            else
                fail("unknown key " + key);
        }
    if (schema.contains("required"))
        for (const auto& key : schema["required"])
            if (!value.contains(key)) fail("lacks " + key.get<std::string>());
}

std::vector<std::string> problems_of(const Json& schema, const std::string& text) {
    std::ostringstream json;
    json << toml::json_formatter{toml::parse(text)};
    std::vector<std::string> wrong;
    check(schema, Json::parse(json.str()), "", wrong);
    return wrong;
}

TEST(Keys, TheReferenceIsWhatTheProgramWrites) {
    EXPECT_EQ(contents(testing::source_dir() + "/scenes/KEYS.md"), key_markdown(file_kinds()))
        << "write it anew: build/release/palpate keys --markdown > scenes/KEYS.md";
}

TEST(Keys, EachHasASentenceAndANumberItsUnitAndRange) {
    const std::vector<std::pair<std::string, std::string>> endings{{"_mm", "mm"},
                                                                   {"_um", "um"},
                                                                   {"_deg", "deg"},
                                                                   {"_s", "s"},
                                                                   {"_ms", "ms"},
                                                                   {"_kPa", "kPa"},
                                                                   {"_g", "g"},
                                                                   {"_kg_per_m3", "kg/m^3"},
                                                                   {"_N_per_mm", "N/mm"},
                                                                   {"_kPa_per_mm", "kPa/mm"},
                                                                   {"_m_per_s", "m/s"},
                                                                   {"_deg_per_s", "deg/s"},
                                                                   {"_rad_per_s", "rad/s"},
                                                                   {"_N", "N"},
                                                                   {"_us", "us"},
                                                                   {"_Nm", "N m"},
                                                                   {"_um_per_s", "um/s"},
                                                                   {"_mm_per_s", "mm/s"},
                                                                   {"_per_Nm", "per N m"},
                                                                   {"Hz_per_mm_per_s", "Hz per mm/s"},
                                                                   {"Hz_per_deg_per_s", "Hz per deg/s"}};
    int numbers = 0;
    for (const KeyInfo& kind : file_kinds())
        for_each_key(kind, kind.name + ".", [&](const KeyInfo& k, const std::string& path) {
            EXPECT_GT(k.sentence.size(), 8u) << path;
            EXPECT_EQ(k.sentence.back(), '.') << path;
            EXPECT_TRUE(k.type != Type::choice || k.words.size() >= 2) << path;
            if (k.type != Type::number && k.type != Type::vector && k.type != Type::integer) return;
            ++numbers;
            EXPECT_LT(k.range.low, k.range.high) << path;
            // The unit that the name ends with, the longest that fits, is the key's.
            std::string unit;
            std::size_t longest = 0;
            for (const auto& [ending, name] : endings)
                if (k.name.ends_with(ending) && ending.size() > longest) unit = name, longest = ending.size();
            EXPECT_EQ(k.type == Type::integer ? "" : longest > 0 ? unit : k.unit, k.unit) << path;
        });
    EXPECT_GT(numbers, 100);
}

TEST(Keys, EveryShippedFileFitsTheSchema) {
    const auto kinds = file_kinds();
    const std::string root = testing::source_dir();
    const Json scene = key_schema(kinds[0]), finger = key_schema(kinds[1]);
    int files = 0;
    for (const auto& [folder, schema] :
         {std::pair{"/scenes", &scene}, std::pair{"/scenes/templates", &scene}, std::pair{"/meshes/fingers", &finger}})
        for (const auto& file : toml_files(root + folder)) {
            const auto wrong = problems_of(*schema, contents(file));
            EXPECT_TRUE(wrong.empty()) << file << wrong.front();
            ++files;
        }
    EXPECT_GT(files, 30);
}

TEST(Keys, WrongScenesDoNotFitTheSchema) {
    const Json schema = key_schema(file_kinds()[0]);
    const std::string finger = "[[finger]]\n";
    EXPECT_TRUE(problems_of(schema, "title = \"x\"\ndt_ms = 5\n" + finger).empty());
    EXPECT_TRUE(problems_of(schema, "[solver]\npreset = \"real-time\"\ndetail = \"auto\"\n").empty());
    for (const char* wrong :
         {"titel = \"x\"", "title = 3", "dt_ms = 0", "dt_ms = 1e9", "dt_ms = \"5\"", "gravity_m_per_s2 = [0, 0]",
          "gravity_m_per_s2 = [0, 0, \"9.81\"]", "[solver]\npreset = \"fastest\"", "[solver]\nnewton_iterations = 1.5",
          "[solver]\nstatic = 1", "[recording]\nspeed = 2", "[[finger]]\nelements = 3",
          "[[finger]]\ntrack = [ { position_mm = [0, 0, 0] } ]", "[[finger]]\ndevice = { channels = [1, -2] }",
          "[finger]\nname = \"x\"", "[[object]]\nkind = \"torus\"", "[[object]]\nmass = 3"})
        EXPECT_FALSE(problems_of(schema, wrong).empty()) << wrong;
}

/// Meshed once for all scenes of a test.
FingerTemplates& meshes() {
    static FingerTemplates all;
    return all;
}

/// What the loader says of a scene with these settings; without a finger no mesh is built.
std::string refusal(const std::vector<std::string>& settings, const std::string& scene = "title = \"x\"\n") {
    const testing::ScratchFolder scratch;
    const auto file = scratch.path / "scene.toml";
    std::ofstream(file) << scene;
    try {
        load_scene(file, settings, &meshes());
        return "";
    } catch (const InputError& error) { return error.what(); }
}

TEST(Keys, APairHasOneFriction) {
    const std::string things =
                          "[[object]]\nname = \"a\"\n[[object]]\nname = \"b\"\nkind = \"box\"\nsize_mm = [9, 9, 9]\n"
                          "position_mm = [0, 0, 90]\nmass_g = 3\n"
                          "[[finger]]\nelements = 60\ntrack = [ { t_s = 0, position_mm = [300, 0, 90] } ]\n",
                      pair = "[[friction]]\nfirst = \"a\"\nsecond = \"b\"\ncoefficient = 0.1\n",
                      turned = "[[friction]]\nfirst = \"b\"\nsecond = \"a\"\ncoefficient = 1\n";
    EXPECT_EQ(refusal({}, things + pair), "");
    for (const std::string& again : {pair, turned})
        EXPECT_NE(refusal({}, things + pair + again).find("has a coefficient already"), std::string::npos);
}

TEST(Keys, EveryKeyOfTheSchemaIsReadByTheLoader) {
    // A value of the wrong type under a key is an error that names the key, not an unknown key.
    const auto kinds = file_kinds();
    int keys = 0;
    for (const KeyInfo& k : kinds[0].keys) {
        if (k.type != Type::table) continue;
        std::vector<std::string> settings;
        for (const KeyInfo& inner : k.keys)
            settings.push_back(k.name + "." + inner.name + "=" +
                               (inner.type == Type::boolean || inner.type == Type::text ? "1" : "true"));
        const std::string said = refusal(settings);
        for (const KeyInfo& inner : k.keys)
            EXPECT_NE(said.find(k.name + "." + inner.name + ": expected"), std::string::npos) << said;
        EXPECT_EQ(said.find("unknown key"), std::string::npos) << said;
        keys += int(k.keys.size());
    }
    EXPECT_GT(keys, 50);
}

TEST(Keys, LoaderAndEngineHaveTheSameRanges) {
    const auto kinds = file_kinds();
    auto setting = [](const std::string& key, double value) {
        char text[120];
        std::snprintf(text, sizeof text, "%s=%.12g", key.c_str(), value);
        return std::string(text);
    };
    std::vector<std::string> lowest, highest, below, above, keys;
    for (const char* table : {"solver", "coupling", "limits", "material"})
        for (const KeyInfo& k : find_table(kinds, table).keys) {
            if (k.type != Type::number && k.type != Type::integer) continue;
            const std::string key = std::string(table) + "." + k.name;
            keys.push_back(key);
            lowest.push_back(setting(key, k.range.low)), highest.push_back(setting(key, k.range.high));
            below.push_back(setting(key, -1));
            above.push_back(setting(key, k.type == Type::integer ? k.range.high + 1 : 1.001 * k.range.high));
        }
    EXPECT_GT(keys.size(), 25u);
    // The engine's own validation is part of loading: what the loader lets through, it accepts.
    const std::string finger = "[[finger]]\nname = \"f\"\nelements = 20\n";
    for (auto* inside : {&lowest, &highest})
        for (const char* level : {"full", "auto"}) {
            inside->push_back(std::string("solver.level_of_detail=") + level);
            EXPECT_EQ(refusal(*inside, finger), "");
        }
    for (const auto* outside : {&below, &above}) {
        const std::string said = refusal(*outside);
        for (const std::string& key : keys) EXPECT_NE(said.find(key + ": expected"), std::string::npos) << key << said;
    }
}

TEST(Keys, TablesAreFoundByTheirPaths) {
    const auto kinds = file_kinds();
    EXPECT_EQ(find_table(kinds, "").name, "scene");
    EXPECT_EQ(find_table(kinds, "finger.device").name, "device");
    EXPECT_EQ(find_table(kinds, "calibration.servo").name, "servo");
    EXPECT_NE(key_listing(kinds, "coupling").find("max_spin_deg_per_s"), std::string::npos);
    EXPECT_NE(key_listing(kinds, "calibration.servo").find("[[servo]]"), std::string::npos);
    for (const char* wrong : {"solve", "finger.devise", "."}) try {
            find_table(kinds, wrong);
            ADD_FAILURE() << wrong;
        } catch (const InputError& error) {
            EXPECT_NE(std::string(error.what()).find(*wrong == '.' ? "known here" : "did you mean"), std::string::npos);
        }
}

TEST(Keys, OlderNamesAreAcceptedWithANote) {
    const testing::ScratchFolder scratch;
    const auto file = scratch.path / "scene.toml";
    const std::string finger = "[[finger]]\nname = \"f\"\nelements = 20\n";
    std::ofstream(file) << finger << "[solver]\npreset = \"real-time\"\ndetail = \"auto\"\ndetail_error = 0.02\n";
    const Scene older = load_scene(file, {}, &meshes());
    EXPECT_EQ(older.spec.solver.detail_error, 0.02);
    EXPECT_EQ(older.spec.solver.newton_iterations, 2);
    ASSERT_EQ(older.notes.size(), 2u);
    EXPECT_NE(older.notes[0].find("scene.toml:6:"), std::string::npos) << older.notes[0];
    EXPECT_NE(older.notes[0].find("level_of_detail now"), std::string::npos) << older.notes[0];
    EXPECT_TRUE(older.warnings.empty());
    // What the command line says wins, under either name.
    EXPECT_EQ(load_scene(file, {"solver.level_of_detail_error=0.03"}, &meshes()).spec.solver.detail_error, 0.03);
    std::ofstream(file) << finger << "[solver]\nlevel_of_detail = \"full\"\n";
    EXPECT_GT(load_scene(file, {"solver.detail=auto"}, &meshes()).spec.solver.detail_error, 0);
    std::ofstream(file) << finger << "[solver]\nlevel_of_detail = \"full\"\ndetail = \"auto\"\n";
    EXPECT_THROW(load_scene(file, {}, &meshes()), InputError);
}

}  // namespace
}  // namespace palpate
