// SPDX-License-Identifier: Apache-2.0
#include "services/episode/bounded_json.h"

#include <algorithm>
#include <set>
#include <string>
#include <vector>

namespace etude {

std::optional<OrderedJson> ParseBoundedJson(std::string_view text, int max_depth) {
  using Event = OrderedJson::parse_event_t;
  bool good = true;
  std::vector<std::set<std::string>> open_objects;

  // once something is wrong, everything is dropped, so that a deep text does not make a deep value
  const auto watch = [&](int depth, Event event, OrderedJson& parsed) {
    if (depth > max_depth) good = false;
    if (!good) return false;
    if (event == Event::object_start) open_objects.emplace_back();
    if (event == Event::object_end) open_objects.pop_back();
    if (event == Event::key && !open_objects.back().insert(parsed.get<std::string>()).second) good = false;
    return good;
  };
  OrderedJson json = OrderedJson::parse(text, watch, /*allow_exceptions=*/false);
  if (!good || json.is_discarded()) return std::nullopt;
  return json;
}

bool IsBounded(const OrderedJson& json, int max_depth) {
  if (!json.is_structured() || json.empty()) return true;
  // the parser counts what is open around a value
  return max_depth > 0 &&
         std::all_of(json.begin(), json.end(), [&](const OrderedJson& in) { return IsBounded(in, max_depth - 1); });
}

}  // namespace etude
