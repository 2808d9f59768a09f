// SPDX-License-Identifier: Apache-2.0
#include "services/campaign/suite_report.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <vector>

#include "services/core/statistics.h"

namespace etude::campaign {
namespace {

struct Tally {
  std::uint64_t n = 0, successes = 0, latched = 0;

  void Add(const RolloutRow& row) {
    ++n;
    successes += row.success;
    latched += row.success_latched;
  }
};

OrderedJson OcclusionJson(const CampaignSpec& spec, const std::map<std::uint64_t, RolloutRow>& rows) {
  std::vector<double> covered;
  for (const auto& [index, row] : rows)
    if (row.covered) covered.push_back(*row.covered);
  OrderedJson json{{"share", spec.rollout.occlude}};
  if (!covered.empty()) json["covered"] = Mean(covered);
  return json;
}

OrderedJson PushesJson(const CampaignSpec& spec, const std::map<std::uint64_t, RolloutRow>& rows) {
  Tally pushed, others;
  std::uint64_t made = 0, missed = 0;
  for (const auto& [index, row] : rows) {
    const int pushes = row.pushes.value_or(0);
    (pushes > 0 ? pushed : others).Add(row);
    made += static_cast<std::uint64_t>(pushes);
    missed += static_cast<std::uint64_t>(row.pushes_missed);
  }
  OrderedJson json{{"asked", spec.rollout.pushes.count}, {"made", made}, {"missed", missed}, {"rollouts", pushed.n}};
  json["success"] = ShareJson(pushed.successes, pushed.n);
  json["not_pushed"] = others.n;
  json["success_not_pushed"] = ShareJson(others.successes, others.n);
  return json;
}

OrderedJson PerSentence(const CampaignSpec& spec, const std::map<std::uint64_t, RolloutRow>& rows) {
  const auto& sentences = spec.rollout.sentences;
  std::vector<Tally> tallies(sentences.size());
  for (const auto& [index, row] : rows) tallies[index % sentences.size()].Add(row);
  OrderedJson list = OrderedJson::array();
  for (std::size_t i = 0; i < sentences.size(); ++i) {
    OrderedJson json{{"text", sentences[i].text}, {"task", sentences[i].task}, {"object", sentences[i].object}};
    if (!sentences[i].reference.empty()) json["reference"] = sentences[i].reference;
    json["n"] = tallies[i].n;
    json["success"] = ShareJson(tallies[i].successes, tallies[i].n);
    json["success_latched"] = ShareJson(tallies[i].latched, tallies[i].n);
    list.push_back(std::move(json));
  }
  return list;
}

std::string MeaningOf(const OrderedJson& sentence) {
  std::string meaning = sentence["task"].get<std::string>() + " " + sentence["object"].get<std::string>();
  if (sentence.contains("reference")) meaning += ", " + sentence["reference"].get<std::string>();
  return meaning;
}

// Whose words they are not: of the training that the checkpoint tells of, or of one on these scenes.
const char* NeverSeenHeader(const OrderedJson& report) {
  return report.contains("words_of") && report["words_of"] == "campaign" ? "a training on these scenes never says"
                                                                         : "training never said";
}

std::string NeverSeen(const OrderedJson& sentence) {
  if (!sentence.contains("never_seen")) return {};
  const auto words = sentence["never_seen"].get<std::vector<std::string>>();
  return words.empty() ? "-" : fmt::format("{}", fmt::join(words, ", "));
}

}  // namespace

void AddSuites(const CampaignSpec& spec, const std::map<std::uint64_t, RolloutRow>& rows, OrderedJson& report) {
  if (spec.rollout.occlude > 0) report["occlusion"] = OcclusionJson(spec, rows);
  if (spec.rollout.pushes.on()) report["pushes"] = PushesJson(spec, rows);
  if (!spec.rollout.sentences.empty()) report["per_sentence"] = PerSentence(spec, rows);
}

std::string SuitesText(const OrderedJson& report) {
  std::string text;
  if (report.contains("occlusion")) {
    const OrderedJson& occlusion = report["occlusion"];
    text += fmt::format("occlusion: {:.0f} % of the target's pixels asked for", 100 * occlusion["share"].get<double>());
    if (occlusion.contains("covered"))
      text += fmt::format(", {:.1f} % covered on average", 100 * occlusion["covered"].get<double>());
    text += "\n";
  }
  if (report.contains("pushes")) {
    const OrderedJson& pushes = report["pushes"];
    const auto count = [&](const char* key) { return pushes[key].get<std::uint64_t>(); };
    text += fmt::format("pushed: {} rollouts, success {} %; not pushed: {}, {} %; {} pushes made, {} missed\n",
                        count("rollouts"), ShareText(pushes["success"]), count("not_pushed"),
                        ShareText(pushes["success_not_pushed"]), count("made"), count("missed"));
  }
  return text;
}

std::string SentencesText(const OrderedJson& report) {
  if (!report.contains("per_sentence") || report["per_sentence"].empty()) return {};
  std::size_t width = 0;
  bool seen_known = false;
  for (const auto& sentence : report["per_sentence"]) {
    width = std::max(width, sentence["text"].get<std::string>().size());
    seen_known = seen_known || sentence.contains("never_seen");
  }
  std::string text = fmt::format("{:<{}}  {:>7}  {:>7}  {:<20} {}\n", "sentence", width, "success", "latched", "means",
                                 seen_known ? NeverSeenHeader(report) : "");
  for (const auto& sentence : report["per_sentence"]) {
    const auto of = [&](const char* criterion) {
      return fmt::format("{}/{}", sentence[criterion]["successes"].get<std::uint64_t>(),
                         sentence["n"].get<std::uint64_t>());
    };
    text += fmt::format("{:<{}}  {:>7}  {:>7}  {:<20} {}\n", sentence["text"].get<std::string>(), width, of("success"),
                        of("success_latched"), MeaningOf(sentence), NeverSeen(sentence));
  }
  const OrderedJson& overall = report["overall"];
  return text + fmt::format("all sentences, {} rollouts: success {} %, latched {} %\n",
                            overall["n"].get<std::uint64_t>(), ShareText(overall["success"]),
                            ShareText(overall["success_latched"]));
}

}  // namespace etude::campaign
