// SPDX-License-Identifier: Apache-2.0
#include "services/spec/suite_spec.h"

#include <fmt/format.h>

#include <algorithm>

#include "services/spec/campaign_spec.h"
#include "services/spec/object_names.h"
#include "services/spec/task_name.h"

namespace etude {
namespace {

constexpr int kMostPushes = 10;
constexpr double kFurthestPush = 0.15;         // m
constexpr std::size_t kLongestSentence = 500;  // bytes
constexpr std::size_t kMostSentences = 10'000;

std::vector<std::string> Named(const std::vector<std::string>& objects, const std::string& name) {
  std::vector<std::string> found;
  std::ranges::copy_if(objects, std::back_inserter(found), [&](const auto& object) { return IsNamed(object, name); });
  return found;
}

// What is wrong with one sentence; "" when it can be spoken.
std::string Problem(const CampaignSpec& spec, const SentenceSpec& sentence) {
  const auto control = [](unsigned char c) { return c < 0x20; };
  if (sentence.text.empty() || sentence.text.size() > kLongestSentence || std::ranges::any_of(sentence.text, control))
    return fmt::format("text: one line of 1 to {} bytes", kLongestSentence);
  if (std::ranges::count(spec.tasks, sentence.task) == 0) return "task: " + NotKnown(sentence.task, spec.tasks);
  const auto task = ParseTask(sentence.task);
  if (!task) return {};  // said of `tasks` already
  const auto targets = Named(spec.objects, sentence.object);
  if (targets.empty()) return "object: " + NotKnown(sentence.object, SceneNames(spec.objects));
  if (task->relation() == sentence.reference.empty())
    return fmt::format("task '{}' {} reference", sentence.task, task->relation() ? "needs a" : "has no");
  if (!task->relation()) return {};
  const auto references = Named(spec.objects, sentence.reference);
  if (references.empty()) return "reference: " + NotKnown(sentence.reference, SceneNames(spec.objects));
  const bool fits = std::ranges::all_of(targets, [&](const auto& target) {
    return std::ranges::all_of(references, [&](const auto& reference) {
      return ObjectNoun(target) != ObjectNoun(reference) && task->spec->MayRefer(target, reference);
    });
  });
  return fits ? "" : fmt::format("'{}' cannot be the reference of '{}'", sentence.reference, sentence.object);
}

}  // namespace

void TargetPushSpec::Check(std::vector<std::string>& errors) const {
  const auto in_range = [&](const char* key, auto value, auto low, auto high) {
    if (!(value >= low && value <= high))
      errors.push_back(fmt::format("rollout.pushes.{}: {} not in {}..{}", key, value, low, high));
  };
  in_range("count", count, 0, kMostPushes);
  in_range("most", most, 0.005, kFurthestPush);
  in_range("least", least, 0.005, most);
  in_range("latest", latest, 0, 100'000);
  in_range("earliest", earliest, 0, latest);
}

bool IsNamed(const std::string& object, const std::string& name) {
  return SceneName(object) == name || ObjectNoun(object) == name;
}

void CheckSentences(const CampaignSpec& spec, std::vector<std::string>& errors) {
  const auto& sentences = spec.rollout.sentences;
  if (sentences.size() > kMostSentences)
    errors.push_back(fmt::format("rollout.sentences: {}, at most {}", sentences.size(), kMostSentences));
  for (std::size_t i = 0; i < sentences.size(); ++i)
    if (const std::string problem = Problem(spec, sentences[i]); !problem.empty())
      errors.push_back(fmt::format("rollout.sentences[{}] '{}': {}", i, sentences[i].text, problem));
}

}  // namespace etude
