// SPDX-License-Identifier: Apache-2.0
// The part of JSON Schema that openapi.json uses.
#pragma once

#include <fmt/format.h>

#include <string>
#include <vector>

#include "services/core/config.h"

namespace etude {

/// @param document  for "#/components/schemas/NAME"   @param problems  "path: what is wrong", added to
inline void CheckSchema(const OrderedJson& document, const OrderedJson& schema, const OrderedJson& value,
                        const std::string& path, std::vector<std::string>& problems);

namespace internal {

inline bool HasType(const OrderedJson& value, const std::string& type) {
  if (type == "null") return value.is_null();
  if (type == "string") return value.is_string();
  if (type == "boolean") return value.is_boolean();
  if (type == "integer") return value.is_number_integer();
  if (type == "number") return value.is_number();
  if (type == "array") return value.is_array();
  return type == "object" && value.is_object();
}

inline bool TypeFits(const OrderedJson& type, const OrderedJson& value) {
  if (type.is_string()) return HasType(value, type.get<std::string>());
  for (const auto& one : type)
    if (HasType(value, one.get<std::string>())) return true;
  return false;
}

inline void CheckObject(const OrderedJson& document, const OrderedJson& schema, const OrderedJson& value,
                        const std::string& path, std::vector<std::string>& problems) {
  if (schema.contains("required"))
    for (const auto& key : schema["required"])
      if (!value.contains(key.get<std::string>())) problems.push_back(path + ": lacks " + key.get<std::string>());
  for (const auto& [key, item] : value.items()) {
    const std::string at = path + "." + key;
    if (schema.contains("properties") && schema["properties"].contains(key))
      CheckSchema(document, schema["properties"][key], item, at, problems);
    else if (schema.contains("additionalProperties") && schema["additionalProperties"] == false)
      problems.push_back(at + ": is not described");
    else if (schema.contains("additionalProperties") && schema["additionalProperties"].is_object())
      CheckSchema(document, schema["additionalProperties"], item, at, problems);
  }
}

}  // namespace internal

inline void CheckSchema(const OrderedJson& document, const OrderedJson& schema, const OrderedJson& value,
                        const std::string& path, std::vector<std::string>& problems) {
  if (schema.contains("$ref")) {
    const std::string pointer = schema["$ref"].get<std::string>().substr(1);
    return CheckSchema(document, document.at(OrderedJson::json_pointer(pointer)), value, path, problems);
  }
  if (schema.contains("anyOf")) {
    std::vector<std::string> last;
    for (const auto& one : schema["anyOf"]) {
      last.clear();
      CheckSchema(document, one, value, path, last);
      if (last.empty()) return;
    }
    // the word of the first is of more use than "no null"
    last.clear();
    CheckSchema(document, schema["anyOf"][0], value, path, last);
    problems.insert(problems.end(), last.begin(), last.end());
    return;
  }
  if (schema.contains("type") && !internal::TypeFits(schema["type"], value)) {
    problems.push_back(
        fmt::format("{}: {} is not of type {}", path, value.dump().substr(0, 60), schema["type"].dump()));
    return;
  }
  if (schema.contains("enum")) {
    bool known = false;
    for (const auto& one : schema["enum"]) known = known || one == value;
    if (!known) problems.push_back(fmt::format("{}: {} is not one of {}", path, value.dump(), schema["enum"].dump()));
  }
  if (value.is_object()) internal::CheckObject(document, schema, value, path, problems);
  if (value.is_array() && schema.contains("items"))
    for (std::size_t i = 0; i < value.size(); ++i)
      CheckSchema(document, schema["items"], value[i], fmt::format("{}[{}]", path, i), problems);
}

}  // namespace etude
