// SPDX-License-Identifier: Apache-2.0
#include "worker/view/task_check.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <map>

#include "services/language/grammar.h"
#include "services/spec/object_names.h"
#include "services/spec/task_roles.h"
#include "worker/task/attempt.h"
#include "worker/task/judge.h"
#include "worker/task/predicates/kind.h"
#include "worker/task/start_rule.h"

namespace etude {
namespace {

constexpr int kOnTable = 4;    // objects in each scene that is tried
constexpr int kSentences = 3;  // shown

void Line(const std::string& what, const std::string& text) { fmt::print("{:<10} {}\n", what, text); }

// The tabletop's objects and those that the task asks for.
std::vector<std::string> ObjectsFor(const TaskSpec& task) {
  std::vector<std::string> objects = TabletopObjects();
  for (const auto& name : task.reference.only)
    if (std::ranges::find(objects, name) == objects.end() && CheckObjectName(name)) objects.push_back(name);
  return objects;
}

std::string StageWords(const StageSpec& stage) {
  const OrderedJson parameters = std::visit([](const auto& primitive) { return ToJson(primitive); }, stage);
  std::vector<std::string> words;
  for (const auto& [key, value] : parameters.items())
    words.push_back(fmt::format("{} {}", key, value.is_string() ? value.get<std::string>() : value.dump()));
  return words.empty() ? std::string(NameOf(stage)) : fmt::format("{} ({})", NameOf(stage), fmt::join(words, ", "));
}

// "risen: the object's origin is higher than where it stood (by 0.03 m)", a line a node.
void PrintTree(const PredicateSpec& tree, int depth) {
  const auto& kinds = task::PredicateKinds();
  const auto kind = std::ranges::find_if(kinds, [&](const auto& known) { return known.name == tree.kind; });
  std::vector<std::string> words;
  if (kind != kinds.end())
    for (const auto& parameter : kind->parameters) {
      const auto written = tree.parameters.find(parameter.name);
      const bool is_number = parameter.type == task::PredicateParameter::Type::kNumber;
      std::string value = is_number ? fmt::format("{:.4g}", parameter.value) : parameter.words.front();
      if (written != tree.parameters.end())
        value = written->second.is_word() ? written->second.word : fmt::format("{:.4g}", written->second.number);
      words.push_back(fmt::format("{} {}{}", parameter.name, value, is_number ? " " + parameter.unit : ""));
    }
  const std::string says = kind == kinds.end() ? "" : ": " + kind->says;
  Line("", fmt::format("{:{}}{}{}{}", "", 2 * depth, tree.kind, says,
                       words.empty() ? "" : fmt::format(" ({})", fmt::join(words, ", "))));
  for (const auto& child : tree.children) PrintTree(child, depth + 1);
}

void PrintStart(const StartSpec& start) {
  Line("start", start.roomy() ? "space before and behind every object" : "objects where there is room");
  if (!start.keep_clear.empty())
    Line("", fmt::format("no obstacle at {} places around the target", start.keep_clear.size()));
  if (!start.not_already) return;
  Line("", "not already:");
  PrintTree(*start.not_already, 1);
}

Status PrintMeaning(const TaskName& task, const std::vector<std::string>& objects) {
  const TaskSpec& spec = *task.spec;
  Line("task", spec.summary.empty() ? spec.name : fmt::format("{}: {}", spec.name, spec.summary));
  const std::vector<std::string> targets = PossibleTargets(spec, objects);
  if (targets.empty())
    return Fail(Code::kInvalidArgument, fmt::format("task '{}': reference.only: none of {} is an object", spec.name,
                                                    fmt::join(spec.reference.only, ", ")));
  ETUDE_ASSIGN_OR_RETURN(const auto grammar, language::Grammar::LoadFor(SceneNames(objects), {task.base}));
  const std::string target = SceneName(targets.front());
  const auto references = PossibleReferences(spec, targets.front(), objects);
  const auto command =
      language::CommandFor(task, target, references.empty() ? std::string() : SceneName(references.front()));
  ETUDE_RETURN_IF_ERROR(grammar.Check(command));
  const auto sentences = grammar.Templates(command);
  for (std::size_t i = 0; i < std::min<std::size_t>(kSentences, sentences.size()); ++i)
    Line(i == 0 ? "sentences" : "", fmt::format("\"{}\"", sentences[i]));
  if (spec.reference.needed)
    Line("reference",
         spec.reference.only.empty() ? "any other object" : fmt::format("{}", fmt::join(spec.reference.only, ", ")));
  for (const auto& variant : spec.avoid)
    Line("also",
         fmt::format("'{}+{}': {}", spec.name, variant,
                     variant == "obstacle" ? "without touching the obstacle" : "without touching other objects"));
  PrintStart(spec.start);
  for (std::size_t i = 0; i < spec.stages.size(); ++i) Line(i == 0 ? "stages" : "", StageWords(spec.stages[i]));
  Line("done", fmt::format("when for {} control steps", task::kDwell));
  PrintTree(spec.success, 1);
  Line("latched", "when once, as the paper's authors count");
  PrintTree(spec.latched.value_or(spec.success), 1);
  return {};
}

// How many attempts succeed; prints it.
Result<int> Try(const TaskName& task, const std::string& robot, const std::vector<std::string>& objects, int attempts,
                const sim::RendererConfig& renderer) {
  CampaignSpec spec;
  spec.robots = {robot};
  spec.tasks = {task.text()};
  spec.objects = objects;
  spec.objects_per_scene = kOnTable;
  ETUDE_ASSIGN_OR_RETURN(auto runner, task::AttemptRunner::Open(spec, renderer));
  int succeeded = 0;
  std::map<std::string, int> reasons;
  for (int index = 0; index < attempts; ++index) {
    ETUDE_ASSIGN_OR_RETURN(const auto attempt, runner.Demonstrate(static_cast<std::uint64_t>(index), 0));
    if (attempt.outcome == task::AttemptOutcome::kSuccess)
      ++succeeded;
    else
      ++reasons[fmt::format("{}: {}", task::ToString(attempt.outcome), attempt.reason)];
  }
  Line(2 * succeeded > attempts ? "ok" : "FAILS",
       fmt::format("{}: {} of {} demonstrations succeed", robot, succeeded, attempts));
  for (const auto& [reason, count] : reasons) Line("", fmt::format("  {} x {}", count, reason));
  return succeeded;
}

}  // namespace

Status CheckTaskFile(const std::string& name, const TaskCheckOptions& options, const sim::RendererConfig& renderer) {
  ETUDE_ASSIGN_OR_RETURN(const TaskName task, ParseTask(name));
  ETUDE_RETURN_IF_ERROR(task::CheckPredicates(*task.spec));
  const std::vector<std::string> objects = ObjectsFor(*task.spec);
  ETUDE_RETURN_IF_ERROR(PrintMeaning(task, objects));
  bool works = false;
  for (const std::string& robot : options.robots) {
    ETUDE_ASSIGN_OR_RETURN(const int succeeded, Try(task, robot, objects, options.attempts, renderer));
    works = works || 2 * succeeded > options.attempts;
  }
  if (works) return {};
  return Fail(Code::kInvalidArgument, fmt::format("task '{}' works on none of {}: the reasons are above", name,
                                                  fmt::join(options.robots, ", ")));
}

}  // namespace etude
