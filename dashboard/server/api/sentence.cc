// SPDX-License-Identifier: Apache-2.0
#include "dashboard/server/api/sentence.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <vector>

#include "services/core/clock.h"

namespace etude::api {
namespace {

std::string Collection(const CollectionFacts& facts) {
  std::string text = facts.name + ": ";
  if (facts.state == "finished") {
    text += fmt::format("collected {}", Grouped(facts.committed));
    if (facts.given_up > 0) text += fmt::format(", gave up {}", Grouped(facts.given_up));
    return text;
  }
  if (facts.state == "running") {
    text += fmt::format("collecting {} of {}", Grouped(facts.committed), Grouped(facts.total));
    if (facts.eta_s) text += ", done in " + FormatDuration(*facts.eta_s);
    return text;
  }
  return text + fmt::format("{} at {} of {}", facts.state == "failed" ? "collection failed" : "collection silent",
                            Grouped(facts.committed), Grouped(facts.total));
}

std::string Stage(const TrainingFacts& facts) {
  std::string text;
  if (facts.stage > 0 && facts.stages > 0) text = fmt::format("stage {}/{}", facts.stage, facts.stages);
  if (!text.empty() && !facts.stage_name.empty()) text += " " + facts.stage_name;
  return text;
}

std::string Training(const TrainingFacts& facts) {
  const std::string stage = Stage(facts);
  if (facts.state == "finished") {
    std::string text = "trained";
    if (facts.elapsed_s) text += " " + FormatDuration(*facts.elapsed_s);
    if (!stage.empty()) text += " to " + stage;
    return text;
  }
  const std::string verb = facts.state == "running" ? "training" : "training " + facts.state + " at";
  std::string text = verb + (stage.empty() ? "" : " " + stage + ",") + " step " + Grouped(facts.step);
  if (facts.state == "running" && facts.eta_s) text += ", done in " + FormatDuration(*facts.eta_s);
  return text;
}

std::string Policy(const PolicyFacts& facts) {
  if (facts.servers == 0) return "";
  const std::string servers = facts.servers == 1 ? "a policy server" : fmt::format("{} policy servers", facts.servers);
  return facts.step ? fmt::format("step {} on {}", Grouped(*facts.step), servers) : servers + " up";
}

std::string Evaluation(const EvaluationFacts& facts) {
  if (facts.done == 0) return facts.state == "running" ? "evaluating" : "";
  const std::string share = fmt::format("{:.1f} % success", 100 * facts.share);
  if (facts.state == "finished") return share + " of " + Grouped(facts.done);
  return fmt::format("{} of {} rollouts, {}", Grouped(facts.done), Grouped(facts.episodes), share);
}

}  // namespace

std::string Grouped(std::uint64_t number) {
  const std::string digits = fmt::format("{}", number);
  std::string text;
  for (std::size_t i = 0; i < digits.size(); ++i) {
    if (i > 0 && (digits.size() - i) % 3 == 0) text += ',';
    text += digits[i];
  }
  return text;
}

std::string Sentence(const Facts& facts) {
  std::vector<std::string> parts;
  if (facts.collection) parts.push_back(Collection(*facts.collection));
  if (facts.training) parts.push_back(Training(*facts.training));
  if (facts.policy) parts.push_back(Policy(*facts.policy));
  if (facts.evaluation) parts.push_back(Evaluation(*facts.evaluation));
  std::erase(parts, "");
  if (parts.empty()) return fmt::format("nothing found in {}", facts.looked_in);
  return fmt::format("{}", fmt::join(parts, "; "));
}

}  // namespace etude::api
