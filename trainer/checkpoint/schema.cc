// SPDX-License-Identifier: Apache-2.0
#include "trainer/checkpoint/schema.h"

#include <fmt/format.h>

#include <charconv>

#include "services/core/hash.h"
#include "services/episode/bounded_json.h"
#include "trainer/checkpoint/embodiment.h"
#include "trainer/policy/architecture.h"
#include "trainer/policy/config.h"
#include "trainer/policy/upgrade.h"

namespace etude::checkpoint {
namespace {

using Text = std::map<std::string, std::string>;

constexpr std::string_view kPrefix = "etude checkpoint ";
constexpr int kMaxDepth = 16;  // of JSON in metadata

// what schema 1 hashed: every key but those that shape no weight
std::string HashOfSchema1(OrderedJson policy) {
  for (const char* key : {"name", "attention_loss", "precision"}) policy.erase(key);
  if (policy.contains("modules") && policy["modules"].is_array()) {
    for (auto& module : policy["modules"]) {
      if (!module.is_object()) continue;
      for (const char* key : {"attend", "attend_weight", "detach"}) module.erase(key);
      if (!module.contains("decoder") || !module["decoder"].is_object()) continue;
      for (const char* key : {"weight", "detach"}) module["decoder"].erase(key);
    }
  }
  return Sha256Hex(JsonText(policy));
}

// the number named NAME.KIND among the metrics, as an error
std::optional<double> ErrorOfSchema1(const OrderedJson& metrics, const std::string& module) {
  const auto value = [&](const char* kind) -> std::optional<double> {
    const auto it = metrics.find(module + kind);
    if (it == metrics.end() || !it->is_number()) return std::nullopt;
    return it->get<double>();
  };
  if (const auto accuracy = value(".accuracy")) return 1 - *accuracy;
  if (const auto px = value(".px")) return *px;
  if (const auto cm = value(".cm")) return *cm / 100;
  if (const auto hit = value(".hit")) return 1 - *hit;
  return std::nullopt;
}

// schema 1 says how many levels are in training, and what the last validation found
OrderedJson ModulesOfSchema1(const policy::PolicyConfig& policy, const OrderedJson& metrics, int stage,
                             std::uint64_t step) {
  std::map<int, int> stage_of;  // level -> its stage, from 1
  for (const auto& module : policy.modules) stage_of[module.level] = 0;
  int count = 0;
  for (auto& [level, number] : stage_of) number = ++count;
  OrderedJson modules = OrderedJson::object();
  for (const auto& module : policy.modules) {
    const bool trained = stage_of[module.level] <= stage;
    const auto error = ErrorOfSchema1(metrics, module.name);
    modules[module.name] = {{"trained_steps", trained ? step : 0}};
    modules[module.name]["error"] = error ? OrderedJson(*error) : OrderedJson(nullptr);
  }
  return modules;
}

template <class Number>
Number NumberOr(const Text& text, const char* key, Number otherwise) {
  const auto it = text.find(key);
  if (it != text.end()) std::from_chars(it->second.data(), it->second.data() + it->second.size(), otherwise);
  return otherwise;
}

Status UpgradeFrom1(Text& text, std::map<std::string, torch::Tensor>& tensors) {
  ETUDE_ASSIGN_OR_RETURN(const OrderedJson old, ReadMap(text, "policy_config"));
  const std::string named = text["architecture"], own = HashOfSchema1(old);
  if (named != own)
    return Fail(Code::kCorrupt, fmt::format("checkpoint: architecture {:.12} is named, but its policy_config makes "
                                            "{:.12}",
                                            named, own));
  auto policy = FromJson<policy::PolicyConfig>(policy::UpgradePolicyJson(old), "checkpoint: policy_config");
  if (!policy) return Fail(Code::kCorrupt, policy.error().message);
  if (const auto valid = policy->Validate(); !valid)
    return Fail(Code::kCorrupt, "checkpoint: policy_config: " + valid.error().message);
  policy::UpgradeStateNames(*policy, tensors);
  const OrderedJson said = policy::SaidOf(*policy);
  text["policy_config"] = said.dump();
  text["architecture"] = policy::ArchitectureHash(said);

  ETUDE_ASSIGN_OR_RETURN(const OrderedJson metrics, ReadMap(text, "metrics"));
  text["modules"] =
      ModulesOfSchema1(*policy, metrics, NumberOr(text, "stage", 0), NumberOr(text, "step", std::uint64_t{0})).dump();
  Embodiment embodiment;
  embodiment.joints = NumberOr(text, "joints", 0);
  text["embodiment"] = ToJson(embodiment).dump();
  text["best"] = "0";
  return {};
}

}  // namespace

Result<OrderedJson> ReadMap(const Text& text, const char* key) {
  const auto it = text.find(key);
  if (it == text.end()) return Fail(Code::kCorrupt, fmt::format("checkpoint: metadata has no '{}'", key));
  auto json = ParseBoundedJson(it->second, kMaxDepth);
  if (!json || !json->is_object())
    return Fail(Code::kCorrupt, fmt::format("checkpoint: metadata '{}' is not a JSON map", key));
  return std::move(*json);
}

std::string FormatOf(int schema) { return fmt::format("{}{}", kPrefix, schema); }

Result<int> SchemaOf(const std::map<std::string, std::string>& text) {
  const auto it = text.find("format");
  const std::string format = it == text.end() ? "missing" : it->second;
  int schema = 0;
  const auto [end, error] = format.starts_with(kPrefix)
                                ? std::from_chars(format.data() + kPrefix.size(), format.data() + format.size(), schema)
                                : std::from_chars_result{format.data(), std::errc::invalid_argument};
  if (error != std::errc() || end != format.data() + format.size() || schema < 1)
    return Fail(Code::kCorrupt, fmt::format("checkpoint: format is '{:.100}', expected '{}': a safetensors file, but "
                                            "not a checkpoint of this program",
                                            format, FormatOf(kSchema)));
  if (schema > kSchema)
    return Fail(Code::kInvalidArgument, fmt::format("checkpoint: schema {}, this program reads up to {}; use a newer "
                                                    "one",
                                                    schema, kSchema));
  return schema;
}

Status Upgrade(int schema, std::map<std::string, std::string>& text, std::map<std::string, torch::Tensor>& tensors) {
  if (schema == 1) ETUDE_RETURN_IF_ERROR(UpgradeFrom1(text, tensors));
  return {};
}

}  // namespace etude::checkpoint
