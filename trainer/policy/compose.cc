// SPDX-License-Identifier: Apache-2.0
#include "trainer/policy/compose.h"

#include <algorithm>

#include "trainer/policy/names.h"

namespace etude::policy {
namespace {

bool HasModules(const OrderedJson& policy) {
  return policy.is_object() && policy.contains("modules") && policy["modules"].is_array();
}

bool IsAdditive(const std::string& key) { return key == "reads" || key == "attend" || key == "inputs"; }

// objects key by key; lists that name what is read grow, everything else is replaced
void Merge(OrderedJson& into, const OrderedJson& addition) {
  for (const auto& [key, value] : addition.items()) {
    if (value.is_object() && into.contains(key) && into[key].is_object()) {
      Merge(into[key], value);
    } else if (IsAdditive(key) && value.is_array() && into.contains(key) && into[key].is_array()) {
      for (const auto& item : value)
        if (std::ranges::find(into[key], item) == into[key].end()) into[key].push_back(item);
    } else {
      into[key] = value;
    }
  }
}

OrderedJson* FindByName(OrderedJson& modules, const OrderedJson& entry) {
  if (!entry.is_object() || !entry.contains("name")) return nullptr;
  for (auto& module : modules)
    if (module.is_object() && module.contains("name") && module["name"] == entry["name"]) return &module;
  return nullptr;
}

// What a graph does not say is the default, and an addition adds to that, too.
void FillIn(OrderedJson& own, const OrderedJson& entry) {
  static const OrderedJson defaults = ToJson(ModuleConfig{});
  if (entry.contains("reads") && !own.contains("reads")) own["reads"] = defaults["reads"];
  const auto has_inputs = [](const OrderedJson& module) {
    return module.contains("decoder") && module["decoder"].is_object() && module["decoder"].contains("inputs");
  };
  if (has_inputs(entry) && own.contains("decoder") && own["decoder"].is_object() && !has_inputs(own))
    own["decoder"]["inputs"] = defaults["decoder"]["inputs"];
}

}  // namespace

OrderedJson ModuleEntries(const OrderedJson& policy) {
  return HasModules(policy) ? policy["modules"] : OrderedJson::array();
}

std::string EntryName(const OrderedJson& entry) {
  const bool named = entry.is_object() && entry.contains("name") && entry["name"].is_string();
  return named ? entry["name"].get<std::string>() : "";
}

OrderedJson Compose(const OrderedJson& base, const OrderedJson& addition) {
  OrderedJson result = base;
  OrderedJson rest = addition;
  if (HasModules(result) && HasModules(rest)) {
    for (const auto& entry : rest["modules"]) {
      if (OrderedJson* own = FindByName(result["modules"], entry)) {
        FillIn(*own, entry);
        Merge(*own, entry);
      } else {
        result["modules"].push_back(entry);
      }
    }
    rest.erase("modules");
  }
  if (result.is_object() && rest.is_object()) Merge(result, rest);
  return result;
}

void KeepReads(const OrderedJson& before, OrderedJson& graph) {
  if (!HasModules(before) || !HasModules(graph)) return;
  // of the rest nothing matters here, and it may be written in short
  const auto config = FromJson<PolicyConfig>(OrderedJson{{"modules", before["modules"]}}, "modules");
  if (!config) return;
  for (std::size_t i = 0; i < config->modules.size(); ++i) {
    const OrderedJson& entry = before["modules"][i];
    OrderedJson* now = FindByName(graph["modules"], entry);
    if (now != nullptr && *now == entry) (*now)["reads"] = ResolveReads(*config, config->modules[i]);
  }
}

}  // namespace etude::policy
