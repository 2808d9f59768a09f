// SPDX-License-Identifier: Apache-2.0
#include "trainer/checkpoint/readiness.h"

#include <fmt/format.h>

#include <algorithm>

#include "trainer/policy/names.h"
#include "trainer/policy/parts.h"

namespace etude::checkpoint {

using policy::ModuleConfig;

std::vector<std::string> ControlPath(const policy::PolicyConfig& config) {
  const auto order = policy::EvaluationOrder(config);
  std::set<std::string> needed;
  std::vector<std::string> path;
  // a module only uses earlier ones, so that one walk from the end finds all
  for (auto it = order.rbegin(); it != order.rend(); ++it) {
    const ModuleConfig& module = **it;
    if (!needed.contains(module.name) && !policy::Decodes(module, "trajectory")) continue;
    path.push_back(module.name);
    for (auto& name : policy::ReadParts(config, module)) needed.insert(std::move(name));
  }
  std::reverse(path.begin(), path.end());
  return path;
}

std::string WhyUntrained(const Metadata& metadata) {
  const auto path = ControlPath(metadata.policy);
  if (path.empty()) return "no module decodes a trajectory";
  std::vector<std::string> reasons;
  for (const auto& module : metadata.policy.modules) {
    if (std::find(path.begin(), path.end(), module.name) == path.end()) continue;
    const auto record = metadata.modules.find(module.name);
    if (record == metadata.modules.end() || record->second.trained_steps == 0)
      reasons.push_back(module.name + " has 0 trained steps");
    else if (!record->second.error && !module.decoder.quantity.empty())
      reasons.push_back(module.name + " has no validation error");
  }
  std::string text;
  for (const auto& reason : reasons) text += (text.empty() ? "" : "; ") + reason;
  return text;
}

Status CheckTrained(const Metadata& metadata) {
  const std::string why = WhyUntrained(metadata);
  if (why.empty()) return {};
  return Fail(Code::kUnavailable, fmt::format("the policy of run '{}', step {}, may not drive a robot yet: {}",
                                              metadata.run, metadata.step, why));
}

std::set<std::string> NotBegun(const policy::PolicyConfig& config, const std::map<std::string, ModuleRecord>& records) {
  const auto counts = [](const auto& item) { return item.second.trained_steps > 0; };
  if (std::ranges::none_of(records, counts)) return {};
  std::set<std::string> names;
  for (const ModuleConfig& module : config.modules) {
    if (!policy::HasLoss(module)) continue;
    const auto record = records.find(module.name);
    if (record == records.end() || (record->second.trained_steps == 0 && !record->second.error))
      names.insert(module.name);
  }
  return names;
}

}  // namespace etude::checkpoint
