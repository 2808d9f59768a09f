// SPDX-License-Identifier: Apache-2.0
// What makes a rollout harder than its scene: pushes of the target, and sentences that somebody wrote.
#pragma once

#include <string>
#include <vector>

namespace etude {

/// Pushes of the target while a policy drives, before the robot has touched it. Each slides it over the table to
/// another place where it may stand; times, directions and lengths come from a stream of the episode's own.
struct TargetPushSpec {
  int count = 0;        ///< in a rollout; 0: none
  double least = 0.03;  ///< m
  double most = 0.06;   ///< m
  int earliest = 10;    ///< control step
  int latest = 100;     ///< control step; what could not begin until then is left out and counted

  bool on() const { return count > 0; }
  void Visit(auto& v) {
    v("count", count, "-", "times that the target is pushed before the robot has touched it; 0: never");
    v("least", least, "m", "how far a push moves it, at least");
    v("most", most, "m", "how far a push moves it, at most");
    v("earliest", earliest, "steps of 8 ms", "control step at which a push may begin");
    v("latest", latest, "steps of 8 ms", "control step until which a push must have begun, or it is left out");
  }
  /// Appends every problem to `errors`.
  void Check(std::vector<std::string>& errors) const;
};

/// A sentence and what it means. Objects by the scene's name ("coke") or by their class ("apple": any instance).
struct SentenceSpec {
  std::string text;       ///< as it is said to the policy
  std::string task;       ///< one of the campaign's
  std::string object;     ///< the target
  std::string reference;  ///< of a relation; else ""

  bool operator==(const SentenceSpec&) const = default;
  void Visit(auto& v) {
    v("text", text, "", "what is said to the policy");
    v("task", task, "", "task that the sentence means, one of the campaign's");
    v("object", object, "", "its target: an object of the campaign, or a class of them");
    v("reference", reference, "", "what the target is put beside, on or into; none for other tasks");
  }
};

struct CampaignSpec;

/// Whether `object` of a campaign (a name or a path) is what a sentence calls `name`.
bool IsNamed(const std::string& object, const std::string& name);
/// Appends what keeps the campaign's sentences from being spoken in its scenes.
void CheckSentences(const CampaignSpec& spec, std::vector<std::string>& errors);

}  // namespace etude
