// SPDX-License-Identifier: Apache-2.0
#include "services/episode/attempt_details.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>
#include <vector>

namespace etude {
namespace {

constexpr std::size_t kMostKinds = 256;  // of reasons, of stages: what is beyond counts as "other"
constexpr std::size_t kLongestName = 64;
constexpr char kOther[] = "other";

// One more of `name`, which a stranger may have chosen.
template <class V>
V& Bounded(std::map<std::string, V>& map, const std::string& name) {
  const bool known = map.contains(name) || (map.size() < kMostKinds && name.size() <= kLongestName);
  return map[known ? name : kOther];
}

const OrderedJson* Find(const OrderedJson& json, const char* key) {
  return json.is_object() && json.contains(key) ? &json[key] : nullptr;
}

const std::string* Name(const OrderedJson& json, const char* key) {
  const OrderedJson* value = Find(json, key);
  return value && value->is_string() ? value->get_ptr<const std::string*>() : nullptr;
}

void Merge(Counts& into, const Counts& from) {
  for (const auto& [name, count] : from) Bounded(into, name) += count;
}

}  // namespace

void SceneTally::Add(const OrderedJson& details) {
  const OrderedJson* scene = Find(details, "scene");
  const OrderedJson* drawn = scene ? Find(*scene, "draws") : nullptr;
  if (!drawn || !drawn->is_number_unsigned()) return;
  const auto count = drawn->get<std::uint64_t>();
  ++scenes;
  draws += count;
  first_draw += count == 1;
  const OrderedJson* list = Find(*scene, "rejected");
  if (!list || !list->is_array()) return;
  for (const auto& one : *list)
    if (const std::string* reason = Name(one, "reason")) ++Bounded(rejected, *reason);
}

void SceneTally::Add(const SceneTally& other) {
  scenes += other.scenes;
  first_draw += other.first_draw;
  draws += other.draws;
  Merge(rejected, other.rejected);
}

OrderedJson SceneTally::Json() const {
  OrderedJson json{{"scenes", scenes}};
  if (scenes > 0) json["first_draw"] = static_cast<double>(first_draw) / static_cast<double>(scenes);
  json["draws"] = draws;
  json["rejected"] = rejected;
  return json;
}

void PlanTally::Add(const OrderedJson& details) {
  const OrderedJson* planned = Find(details, "planned");
  if (!planned || !planned->is_array()) return;
  for (const auto& one : *planned) {
    const std::string* stage = Name(one, "stage");
    const std::string* way = Name(one, "way");
    if (stage && way) ++Bounded(Bounded(ways, *stage), *way);
  }
}

void PlanTally::Add(const PlanTally& other) {
  for (const auto& [stage, counts] : other.ways) Merge(Bounded(ways, stage), counts);
}

OrderedJson PlanTally::Json() const {
  OrderedJson json = OrderedJson::object();
  for (const auto& [stage, counts] : ways) {
    std::uint64_t times = 0;
    for (const auto& [way, count] : counts) times += count;
    OrderedJson row{{"times", times}};
    for (const auto& [way, count] : counts) row[way] = static_cast<double>(count) / static_cast<double>(times);
    json[stage] = std::move(row);
  }
  return json;
}

std::string Text(const Counts& counts) {
  std::vector<std::pair<std::string, std::uint64_t>> rows(counts.begin(), counts.end());
  std::stable_sort(rows.begin(), rows.end(), [](const auto& a, const auto& b) { return a.second > b.second; });
  std::string text;
  for (const auto& [name, count] : rows) text += fmt::format("{}{} {}", text.empty() ? "" : ", ", name, count);
  return text;
}

}  // namespace etude
