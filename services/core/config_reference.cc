// SPDX-License-Identifier: Apache-2.0
#include "services/core/config_reference.h"

#include <fmt/format.h>

namespace etude {

std::vector<std::string> MissingFromReference(const std::vector<ConfigKey>& keys) {
  std::vector<std::string> missing;
  for (const auto& key : keys) {
    const bool numeric = key.type.find("integer") != std::string::npos || key.type.find("number") != std::string::npos;
    if (key.meaning.empty()) missing.push_back(key.path + ": no meaning");
    if (numeric && key.unit.empty()) missing.push_back(key.path + ": no unit");
  }
  return missing;
}

std::string FormatReference(const std::vector<ConfigKey>& keys) {
  std::string text;
  for (const auto& key : keys) {
    text += fmt::format("{}  ({}", key.path, key.type);
    if (!key.unit.empty() && key.unit != "-") text += ", " + key.unit;
    if (!key.default_value.empty()) text += ", default " + key.default_value;
    text += ")\n";
    if (!key.meaning.empty()) text += fmt::format("    {}\n", key.meaning);
  }
  return text;
}

void PrintReference(const std::vector<ConfigKey>& keys, bool as_json) {
  if (!as_json) return fmt::print("{}", FormatReference(keys));
  OrderedJson list = OrderedJson::array();
  for (const auto& key : keys)
    list.push_back({{"key", key.path},
                    {"type", key.type},
                    {"unit", key.unit},
                    {"default", key.default_value},
                    {"meaning", key.meaning}});
  fmt::print("{}\n", list.dump(1));
}

}  // namespace etude
