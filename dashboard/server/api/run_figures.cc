// SPDX-License-Identifier: Apache-2.0
#include "dashboard/server/api/run_figures.h"

#include <cmath>

namespace etude::api {
namespace {

using sources::Maybe;
using sources::PartOf;
using sources::TextOf;
using sources::TextOrNull;

struct KeyParts {
  std::string kind, name, module, figure;  // "valid", "TAR3D.cm", "TAR3D", "cm"
};

KeyParts PartsOf(const std::string& key) {
  KeyParts parts;
  const auto slash = key.find('/');
  parts.kind = key.substr(0, slash);
  parts.name = key.substr(slash + 1);
  const auto dot = parts.name.find('.');
  if (dot == std::string::npos) return parts;
  parts.module = parts.name.substr(0, dot);
  parts.figure = parts.name.substr(dot + 1);
  return parts;
}

OrderedJson UnitOf(const KeyParts& parts) {
  const auto& figure = parts.figure;
  if (figure == "cm" || figure.ends_with("_cm")) return "cm";
  if (figure == "px" || figure == "deg") return figure;
  if (figure == "accuracy" || figure == "hit" || figure == "noisy" || figure == "unseen" || figure == "gripper" ||
      parts.name == "data_wait")
    return "share";
  if (parts.name == "samples_per_second") return "1/s";
  return nullptr;
}

}  // namespace

OrderedJson KeysJson(const sources::MetricsTable& metrics) {
  OrderedJson keys = OrderedJson::array();
  for (const auto& [key, series] : metrics.series()) {
    const auto parts = PartsOf(key);
    keys.push_back({{"key", key},
                    {"kind", parts.kind},
                    {"name", parts.name},
                    {"module", TextOrNull(parts.module)},
                    {"unit", UnitOf(parts)},
                    {"n", series.value.size()},
                    {"nulls", series.nulls},
                    {"last", Maybe(metrics.Last(key))}});
  }
  return keys;
}

std::uint64_t CountOfNulls(const sources::MetricsTable& metrics) {
  std::uint64_t count = 0;
  for (const auto& [key, series] : metrics.series()) count += series.nulls;
  return count;
}

OrderedJson NullsJson(const sources::MetricsTable& metrics) {
  constexpr std::size_t kMost = 100;
  OrderedJson nulls = OrderedJson::array();
  for (const auto& [key, series] : metrics.series())
    for (std::size_t i = 0; i < series.value.size() && series.nulls > 0 && nulls.size() < kMost; ++i)
      if (!std::isfinite(series.value[i]))
        nulls.push_back({{"step", static_cast<std::uint64_t>(series.step[i])}, {"key", key}});
  return nulls;
}

std::vector<std::string> Modules(const OrderedJson& config) {
  std::vector<std::string> names;
  for (const auto& module : PartOf(PartOf(config, "policy"), "modules")) names.push_back(TextOf(module, "name"));
  return names;
}

std::string QuantityOf(const OrderedJson& config, const std::string& module) {
  for (const auto& one : PartOf(PartOf(config, "policy"), "modules"))
    if (TextOf(one, "name") == module) return TextOf(PartOf(one, "decoder"), "quantity");
  return "";
}

namespace {

// How the errors of a quantity are shown: `figure` is its name in validations.
struct ErrorShape {
  const char *figure, *unit;
  double scale;  // shown per unit of the file
  bool from_accuracy;
};

// By what the module decodes: before its first validation nothing else tells.
ErrorShape ShapeOf(const OrderedJson& config, const std::string& module) {
  const std::string quantity = QuantityOf(config, module);
  if (quantity == "class" || quantity == "task") return {"accuracy", "-", 1, true};
  if (quantity == "pixel") return {"px", "px", 1, false};
  return {"cm", "cm", 100, false};
}

// A goal in the unit that is shown, and the figure of validation that it is held against.
OrderedJson GoalJson(const sources::RunView& view, const std::string& module, double goal) {
  const ErrorShape shape = ShapeOf(view.config, module);
  OrderedJson json{{"module", module},   {"goal", goal * shape.scale}, {"value", nullptr},
                   {"unit", shape.unit}, {"reached", nullptr},         {"key", nullptr}};
  const std::string key = "valid/" + module + "." + shape.figure;
  if (!view.metrics.series().contains(key)) return json;
  json["key"] = key;
  const auto last = view.metrics.Last(key);
  if (!last) return json;
  const double value = shape.from_accuracy ? 1 - *last : *last;
  json["value"] = value;
  json["reached"] = value <= goal * shape.scale;
  return json;
}

}  // namespace

OrderedJson GoalsJson(const sources::RunView& view) {
  OrderedJson goals = OrderedJson::array();
  const auto& configured = PartOf(PartOf(view.config, "curriculum"), "goals");
  if (!configured.is_object()) return goals;
  for (const auto& [module, goal] : configured.items())
    if (goal.is_number()) goals.push_back(GoalJson(view, module, goal.get<double>()));
  return goals;
}

}  // namespace etude::api
