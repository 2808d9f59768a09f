// SPDX-License-Identifier: Apache-2.0
#include "services/campaign/scene_report.h"

#include <fmt/format.h>

#include "services/spec/attempt_outcome.h"
#include "services/store/attempts.h"

namespace etude::campaign {
void SceneReport::Add(const Episode& rollout) {
  SceneTally tally;
  tally.Add(rollout.details);
  counted_[rollout.index] = tally;
}

void SceneReport::AddFailure(std::uint64_t index, const std::string& outcome, const OrderedJson& details) {
  if (outcome != kSceneInvalid) return;
  SceneTally tally;
  tally.Add(details);
  std::uint64_t rejected = 0;
  for (const auto& [reason, starts] : tally.rejected) rejected += starts;
  std::string reason = fmt::format("no start in {} draws", tally.draws);
  if (rejected < tally.draws || tally.draws == 0)
    reason = "not settled";
  else if (tally.rejected.size() == 1)
    reason = tally.rejected.begin()->first;
  invalid_[index] = reason;
}

void SceneReport::Restore(const Path& folder) {
  store::ForEachAttempt(folder,
                        [&](const store::AttemptLine& line) { AddFailure(line.index, line.outcome, line.details); });
}

OrderedJson SceneReport::Json(const std::string& filter) const {
  SceneTally sum;
  for (const auto& [index, tally] : counted_) sum.Add(tally);
  Counts reasons;
  std::uint64_t invalid = 0;
  for (const auto& [index, reason] : invalid_) {
    if (counted_.contains(index)) continue;
    ++invalid;
    ++reasons[reason];
  }
  OrderedJson json{{"filter", filter}};
  json.update(sum.Json());
  json["invalid"] = invalid;
  json["invalid_reasons"] = reasons;
  return json;
}

std::string ScenesText(const OrderedJson& report) {
  if (!report.is_object() || !report.contains("scenes")) return {};
  const OrderedJson& scenes = report["scenes"];
  const auto count = [&](const char* key) { return scenes.value(key, std::uint64_t{0}); };
  std::string text;
  if (scenes.contains("first_draw"))
    text += fmt::format("scenes: {:.1f} % of {} taken at the first draw, {} draws\n",
                        100 * scenes["first_draw"].get<double>(), count("scenes"), count("draws"));
  if (const auto rejected = scenes.value("rejected", Counts{}); !rejected.empty())
    text += "rejected: " + Text(rejected) + "\n";
  if (count("invalid") > 0)
    text += fmt::format("not in n: {} scenes in which the expert cannot do the task ({})\n", count("invalid"),
                        Text(scenes.value("invalid_reasons", Counts{})));
  return text;
}

}  // namespace etude::campaign
