#include <nlohmann/json.hpp>

#include "scenes/load/key_reference.h"
#include "scenes/load/written_value.h"

namespace palpate {

namespace {

using Type = KeyInfo::Type;

nlohmann::ordered_json schema_of(const KeyInfo& k);

nlohmann::ordered_json object_schema(const KeyInfo& table) {
    nlohmann::ordered_json out{{"type", "object"}, {"additionalProperties", false}};
    nlohmann::ordered_json properties = nlohmann::ordered_json::object(), required = nlohmann::ordered_json::array();
    for (const KeyInfo& k : table.keys) {
        properties[k.name] = schema_of(k);
        if (!k.before.empty()) {
            properties[k.before] = schema_of(k);
            properties[k.before]["description"] = "Is called " + k.name + " now.";
        }
        if (k.required) required.push_back(k.name);
    }
    out["properties"] = properties;
    if (!required.empty()) out["required"] = required;
    return out;
}

nlohmann::ordered_json schema_of(const KeyInfo& k) {
    nlohmann::ordered_json out;
    auto bounded = [&](const char* type) {
        return nlohmann::ordered_json{{"type", type}, {"minimum", k.range.low}, {"maximum", k.range.high}};
    };
    switch (k.type) {
        case Type::number:
            out = bounded("number");
            break;
        case Type::integer:
            out = bounded("integer");
            break;
        case Type::boolean:
            out["type"] = "boolean";
            break;
        case Type::text:
            out["type"] = "string";
            break;
        case Type::choice:
            out["enum"] = k.words;
            for (const std::string& older : k.synonyms) out["enum"].push_back(older);
            break;
        case Type::vector:
            out = {{"type", "array"}, {"minItems", 3}, {"maxItems", 3}};
            out["items"] = bounded("number");
            break;
        case Type::integers:
            out["type"] = "array";
            out["items"] = bounded("integer");
            break;
        case Type::table:
            out = object_schema(k);
            break;
        case Type::tables:
            out["type"] = "array";
            out["items"] = object_schema(k);
            break;
    }
    out["description"] = k.sentence + (k.unit.empty() ? "" : " [" + k.unit + "]");
    if (!k.fallback.empty()) out["default"] = written_value(k.fallback);
    return out;
}

}  // namespace

nlohmann::ordered_json key_schema(const KeyInfo& kind) {
    nlohmann::ordered_json out{{"$schema", "http://json-schema.org/draft-07/schema#"},
                               {"title", "palpate " + kind.name},
                               {"description", kind.sentence}};
    out.update(object_schema(kind));
    return out;
}

}  // namespace palpate
