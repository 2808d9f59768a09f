// SPDX-License-Identifier: Apache-2.0
#include "services/monitor/sentence.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <vector>

#include "services/core/clock.h"

namespace etude::monitor {
namespace {

std::string Stage(const TrainingFacts& facts) {
  std::string text;
  if (facts.stage > 0 && facts.stages > 0) text = fmt::format("stage {}/{}", facts.stage, facts.stages);
  if (!text.empty() && !facts.stage_name.empty()) text += " " + facts.stage_name;
  return text;
}

std::optional<double> Positive(double seconds) { return seconds > 0 ? std::optional(seconds) : std::nullopt; }

}  // namespace

CollectionFacts FactsOf(const std::string& name, const bus::CampaignStatus& status) {
  CollectionFacts facts{name,
                        status.state.empty() ? "running" : status.state,
                        status.committed,
                        status.total,
                        status.given_up,
                        Positive(status.eta_s)};
  const bool all = status.total > 0 && status.committed + status.given_up >= status.total;
  if (status.state == "complete" || all) facts.state = "finished";
  return facts;
}

TrainingFacts FactsOf(const bus::TrainStatus& status) {
  return {status.finished ? "finished" : "running",
          status.stage_name,
          status.stage,
          status.stages,
          status.step,
          Positive(status.eta_s),
          std::nullopt};
}

PolicyFacts FactsOf(const bus::PolicyStatus& status) {
  return {status.step, 1, status.sessions, status.control_trained};
}

std::string Text(const CollectionFacts& facts) {
  const std::string of = fmt::format("{} of {}", Grouped(facts.committed), Grouped(facts.total));
  if (facts.state == "finished") {
    std::string text = "collected " + (facts.committed == facts.total ? Grouped(facts.committed) : of);
    if (facts.given_up > 0) text += fmt::format(", gave up {}", Grouped(facts.given_up));
    return text;
  }
  if (facts.state == "running")
    return "collecting " + of + (facts.eta_s ? ", done in " + FormatDuration(*facts.eta_s) : "");
  if (facts.state == "silent" || facts.state == "failed") return "collection " + facts.state + " at " + of;
  return facts.state + " at " + of;
}

std::string Text(const TrainingFacts& facts) {
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

std::string Text(const PolicyFacts& facts) {
  if (facts.servers == 0) return "";
  const std::string servers = facts.servers == 1 ? "a policy server" : fmt::format("{} policy servers", facts.servers);
  if (!facts.step) return servers + " up";
  if (!facts.may_drive) return fmt::format("step {} answers, not trained to drive yet", Grouped(*facts.step));
  if (!facts.sessions) return fmt::format("step {} on {}", Grouped(*facts.step), servers);
  return fmt::format("step {} serves {} session{}", Grouped(*facts.step), *facts.sessions,
                     *facts.sessions == 1 ? "" : "s");
}

std::string Text(const EvaluationFacts& facts) {
  if (facts.done == 0) return facts.state == "running" ? "evaluating" : "";
  const std::string share = fmt::format("{:.1f} % success", 100 * facts.share);
  if (facts.state == "finished") return share + " of " + Grouped(facts.done);
  return fmt::format("{} of {} rollouts, {}", Grouped(facts.done), Grouped(facts.episodes), share);
}

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
  if (facts.collection) parts.push_back(facts.collection->name + ": " + Text(*facts.collection));
  if (facts.training) parts.push_back(Text(*facts.training));
  if (facts.policy) parts.push_back(Text(*facts.policy));
  if (facts.evaluation) parts.push_back(Text(*facts.evaluation));
  std::erase(parts, "");
  if (parts.empty()) return fmt::format("nothing found in {}", facts.looked_in);
  return fmt::format("{}", fmt::join(parts, "; "));
}

}  // namespace etude::monitor
