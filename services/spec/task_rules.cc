// SPDX-License-Identifier: Apache-2.0
#include "services/spec/task_rules.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>

#include "services/core/enum_name.h"
#include "services/core/file.h"

namespace etude {
namespace {

const std::vector<std::string> kVariants{"obstacle", "others"};
constexpr int kMostSteps = 1000;   // control steps of a stage that waits
constexpr double kMostRoom = 0.5;  // m
constexpr double kMostPush = 0.3;  // m
constexpr double kMostLean = 1.0;  // rad
constexpr double kMostAway = 0.5;  // m of a place that is kept clear

// What the hand is doing between two stages.
enum class Hand { kFree, kBeforeTarget, kBehindTarget, kAroundTarget, kHolding };

std::string_view Words(Hand hand) {
  return EnumName(hand, {{Hand::kFree, "the hand is free"},
                         {Hand::kBeforeTarget, "the hand is before the target, open"},
                         {Hand::kBehindTarget, "the hand is behind the target, closed"},
                         {Hand::kAroundTarget, "the open fingers are round the target"},
                         {Hand::kHolding, "the hand holds the target"}});
}

// Looks at stages one after another.
class StageRules {
 public:
  StageRules(const TaskSpec& task, std::vector<std::string>& errors) : task_(task), errors_(errors) {}

  void Check() {
    for (number_ = 0; number_ < task_.stages.size(); ++number_)
      std::visit([&](const auto& stage) { See(stage); }, task_.stages[number_]);
    if (task_.stages.empty())
      errors_.push_back("stages: at least one");
    else if (!std::holds_alternative<HoldSpec>(task_.stages.back()))
      errors_.push_back(fmt::format("stages: the last one is {}, but must be hold: what was done is looked at then",
                                    NameOf(task_.stages.back())));
  }

 private:
  void See(const ApproachSpec& stage) {
    OneOf("to", stage.to, {"grasp", "push"});
    After({Hand::kFree}, stage.pushes() ? Hand::kBehindTarget : Hand::kBeforeTarget);
  }
  void See(const ReachSpec&) { After({Hand::kBeforeTarget}, Hand::kAroundTarget); }
  void See(const GraspSpec& stage) {
    InRange("min_steps", stage.min_steps, 0, kMostSteps);
    InRange("max_steps", stage.max_steps, std::max(stage.min_steps, 1), kMostSteps);
    After({Hand::kAroundTarget}, Hand::kHolding);
  }
  void See(const LiftSpec& stage) {
    InRange("room", stage.room, 0, kMostRoom);
    NotTurned();
    After({Hand::kHolding}, Hand::kHolding);
  }
  void See(const TurnSpec& stage) {
    InRange("lean", stage.lean, 0, kMostLean);
    After({Hand::kHolding}, Hand::kHolding);
    turned_ = true;
  }
  void See(const CarrySpec& stage) {
    InRange("room", stage.room, 0, kMostRoom);
    Goes(stage.to);
    if (stage.to == "here") Wrong("to: say where, seen from the reference");
    NotTurned();
    After({Hand::kHolding}, Hand::kHolding);
  }
  void See(const PushSpec& stage) {
    InRange("distance", stage.distance, 0, kMostPush);
    InRange("least", stage.least, 0, stage.distance);
    After({Hand::kBehindTarget}, Hand::kFree);
  }
  void See(const PlaceSpec& stage) {
    InRange("gap", stage.gap, 0, 0.1);
    Goes(stage.to);
    const bool carried = number_ > 0 && std::holds_alternative<CarrySpec>(task_.stages[number_ - 1]);
    const std::string from = carried ? std::get<CarrySpec>(task_.stages[number_ - 1]).to : "here";
    if (stage.to != from)
      Wrong(fmt::format("to: goes straight down, so that `carry: {{to: {}}}` has to come just before it", stage.to));
    After({Hand::kHolding}, Hand::kHolding);
  }
  void See(const ReleaseSpec& stage) {
    InRange("steps", stage.steps, 1, kMostSteps);
    After({Hand::kHolding}, Hand::kFree);
    turned_ = false;
  }
  void See(const RetreatSpec& stage) {
    OneOf("along", stage.along, {"up", "approach"});
    InRange("distance", stage.distance, 0, kMostRoom);
    After({Hand::kFree}, Hand::kFree);
  }
  void See(const HoldSpec& stage) { InRange("steps", stage.steps, 1, kMostSteps); }

  void Wrong(const std::string& what) {
    errors_.push_back(fmt::format("stages[{}].{}: {}", number_, NameOf(task_.stages[number_]), what));
  }
  void After(std::initializer_list<Hand> allowed, Hand then) {
    if (std::find(allowed.begin(), allowed.end(), hand_) == allowed.end())
      Wrong(fmt::format("cannot come here: it needs that {}, but {}", Words(*allowed.begin()), Words(hand_)));
    hand_ = then;
  }
  // lift and carry hold what they move as it was grasped
  void NotTurned() {
    if (turned_) Wrong("cannot come after turn: the hand would turn the target back");
  }
  template <class T>
  void InRange(const char* key, T value, T low, T high) {
    if (!(value >= low && value <= high)) Wrong(fmt::format("{}: {} not in {}..{}", key, value, low, high));
  }
  void InRange(const char* key, double value, int low, double high) { InRange<double>(key, value, low, high); }
  void OneOf(const char* key, const std::string& value, const std::vector<std::string>& known) {
    if (std::find(known.begin(), known.end(), value) != known.end()) return;
    Wrong(fmt::format("{}: {}", key, NotKnown(value, known)));
  }
  void Goes(const std::string& to) {
    OneOf("to", to, WheretoNames());
    if (to != "here" && !task_.reference.needed)
      Wrong(fmt::format("to: '{}' is seen from a reference; set `reference: {{needed: true}}`", to));
  }

  const TaskSpec& task_;
  std::vector<std::string>& errors_;
  std::size_t number_ = 0;
  Hand hand_ = Hand::kFree;
  bool turned_ = false;  // what the hand holds
};

void CheckWords(const TaskSpec& task, std::vector<std::string>& errors) {
  if (task.words.verbs.empty()) errors.push_back("words.verbs: at least one");
  if (task.reference.needed && task.words.places.empty())
    errors.push_back("words.places: at least one, as 'to the left of', for a task with a reference");
  if (!task.reference.needed && !task.words.places.empty())
    errors.push_back("words.places: only for a task with a reference; set `reference: {needed: true}`");
  for (const auto* words : {&task.words.verbs, &task.words.places})
    for (const auto& word : *words)
      if (word.empty() || word.front() == ' ' || word.back() == ' ' || word.find("  ") != std::string::npos ||
          !std::all_of(word.begin(), word.end(), [](char c) { return c == ' ' || (c >= 'a' && c <= 'z'); }))
        errors.push_back(fmt::format("words: '{}' must be lower-case words with single spaces", word));
}

void CheckStart(const TaskSpec& task, std::vector<std::string>& errors) {
  if (task.start.boxes != "standard" && task.start.boxes != "roomy")
    errors.push_back(fmt::format("start.boxes: '{}' is not known; known: standard, roomy", task.start.boxes));
  for (const auto& place : task.start.keep_clear)
    if (place.size() != 2 || !std::all_of(place.begin(), place.end(), [](double v) { return std::abs(v) < kMostAway; }))
      errors.push_back("start.keep_clear: pairs of x and y in m, e.g. [[0, 0.07]]");
}

}  // namespace

std::vector<std::string> ProblemsOf(const TaskSpec& task) {
  std::vector<std::string> errors;
  if (!IsPlainName(task.name)) errors.push_back(fmt::format("name: '{}' must match [a-z0-9_-]{{1,64}}", task.name));
  CheckWords(task, errors);
  if (!task.reference.needed && !task.reference.only.empty())
    errors.push_back("reference.only: needs `needed: true` beside it");
  for (const auto& variant : task.avoid)
    if (std::find(kVariants.begin(), kVariants.end(), variant) == kVariants.end())
      errors.push_back(fmt::format("avoid: '{}' is not known; known: {}", variant, fmt::join(kVariants, ", ")));
  CheckStart(task, errors);
  StageRules(task, errors).Check();
  return errors;
}

}  // namespace etude
