// SPDX-License-Identifier: Apache-2.0
#include "dashboard/server/api/differences.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>

namespace etude::api {
namespace {

using sources::TextOf;

void Flatten(const OrderedJson& json, const std::string& path, std::map<std::string, OrderedJson>& leaves) {
  const bool list_of_maps =
      json.is_array() && std::ranges::any_of(json, [](const auto& item) { return item.is_object(); });
  if (json.is_object() && !json.empty()) {
    for (const auto& [key, value] : json.items()) Flatten(value, path.empty() ? key : path + "." + key, leaves);
  } else if (list_of_maps) {
    for (std::size_t i = 0; i < json.size(); ++i) {
      const std::string name = TextOf(json[i], "name");
      Flatten(json[i], fmt::format("{}[{}]", path, name.empty() ? std::to_string(i) : name), leaves);
    }
  } else {
    leaves[path] = http::ForBrowsers(json);
  }
}

// The config of a run, the spec of a dataset or of an evaluation.
Result<OrderedJson> SettingsOf(Context& context, const std::string& id) {
  if (const auto run = OpenRun(context, id)) return run->view->config;
  if (const auto dataset = OpenDataset(context, id)) return dataset->view->info.spec_json;
  ETUDE_ASSIGN_OR_RETURN(const OpenedEval eval, OpenEval(context, id));
  return eval.view->spec;
}

}  // namespace

Result<http::Answer> Diff(Context& context, const http::Request& request) {
  constexpr std::size_t kMost = 500;
  const std::string a = request.query.Get("a").value_or(""), b = request.query.Get("b").value_or("");
  std::map<std::string, OrderedJson> first, second;
  ETUDE_ASSIGN_OR_RETURN(const OrderedJson settings_a, SettingsOf(context, a));
  ETUDE_ASSIGN_OR_RETURN(const OrderedJson settings_b, SettingsOf(context, b));
  Flatten(settings_a, "", first);
  Flatten(settings_b, "", second);
  for (const auto& [key, value] : second) first.try_emplace(key);
  OrderedJson keys = OrderedJson::array();
  std::size_t total = 0;
  for (const auto& [key, value] : first) {
    const auto other = second.find(key);
    const OrderedJson theirs = other == second.end() ? OrderedJson() : other->second;
    if (value == theirs) continue;
    if (++total <= kMost) keys.push_back({{"key", key}, {"a", value}, {"b", theirs}});
  }
  return http::JsonAnswer({{"a", a}, {"b", b}, {"total", total}, {"keys", keys}});
}

}  // namespace etude::api
