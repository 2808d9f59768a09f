// SPDX-License-Identifier: Apache-2.0
#include "worker/view/task_check.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <map>
#include <set>

#include "services/core/config.h"
#include "services/core/stop.h"
#include "services/language/grammar.h"
#include "services/spec/object_names.h"
#include "services/spec/robot_names.h"
#include "services/spec/task_name.h"
#include "services/spec/task_roles.h"
#include "worker/task/attempt.h"
#include "worker/task/judge.h"
#include "worker/task/predicates/kind.h"
#include "worker/task/predicates/task_predicates.h"

namespace etude {
namespace {

constexpr int kOnTable = 4;    // objects in each scene that is tried
constexpr int kSentences = 3;  // shown

// What is found out: printed as it comes, or kept for an object.
class TaskReport {
 public:
  explicit TaskReport(bool as_json) : as_json_(as_json) {}
  void Line(const std::string& what, const std::string& text) const {
    if (!as_json_) fmt::print("{:<10} {}\n", what, text);
  }
  void End() const {
    if (as_json_) fmt::print("{}\n", JsonText(json, 1));
  }
  OrderedJson json;

 private:
  const bool as_json_;
};

// The tabletop's objects and those that the task asks for.
std::vector<std::string> ObjectsFor(const TaskName& task) {
  std::vector<std::string> objects = TabletopObjects();
  for (const auto& name : task.spec->reference.only) {
    const auto& classes = GeneratedClasses();  // of one, any instance will do
    const bool is_class = std::ranges::find(classes, name) != classes.end();
    const std::string object = is_class ? GeneratedObject(name, 0) : name;
    if (std::ranges::find(objects, object) == objects.end() && CheckObjectName(object)) objects.push_back(object);
  }
  for (const auto& name : task::NamedObjects(*task.spec, {})) {
    const bool put_there = name == kObstacleObject && task.avoid == "obstacle";
    if (!put_there && std::ranges::find(objects, name) == objects.end()) objects.push_back(name);
  }
  return objects;
}

// Some of `objects` are drawn for each scene, unless predicates name any: these have to stand in all scenes, so that
// all have the same few: the named ones, then what may be the reference, then others; one of a class, as on every
// table.
void ChooseObjects(const TaskSpec& task, const std::vector<std::string>& objects, CampaignSpec& spec) {
  spec.objects = objects;
  spec.objects_per_scene = kOnTable;
  const auto named = task::NamedObjects(task, SceneNames(objects));
  if (named.empty()) return;
  const auto rank = [&](const std::string& object) {
    if (std::ranges::count(named, SceneName(object)) > 0) return 0;
    return task.MayRefer("", object) ? 1 : 2;  // whatever the target is
  };
  std::ranges::stable_sort(spec.objects, {}, rank);
  std::set<std::string> nouns;
  std::erase_if(spec.objects, [&](const std::string& object) {
    return !nouns.insert(ObjectNoun(object)).second && rank(object) > 0;
  });
  const int least = static_cast<int>(std::ranges::count(spec.objects, 0, rank)) + (task.reference.needed ? 1 : 0);
  spec.objects.resize(std::min(spec.objects.size(), static_cast<std::size_t>(std::max(kOnTable, least))));
  spec.objects_per_scene = 0;
}

std::string StageWords(const StageSpec& stage) {
  const OrderedJson parameters = std::visit([](const auto& primitive) { return ToJson(primitive); }, stage);
  std::vector<std::string> words;
  for (const auto& [key, value] : parameters.items())
    words.push_back(fmt::format("{} {}", key, value.is_string() ? value.get<std::string>() : value.dump()));
  return words.empty() ? std::string(NameOf(stage)) : fmt::format("{} ({})", NameOf(stage), fmt::join(words, ", "));
}

// "risen: the object's origin is higher than where it stood (by 0.03 m)", a line a node.
void PrintTree(const PredicateSpec& tree, int depth, const TaskReport& report) {
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
  report.Line("", fmt::format("{:{}}{}{}{}", "", 2 * depth, tree.kind, says,
                              words.empty() ? "" : fmt::format(" ({})", fmt::join(words, ", "))));
  for (const auto& child : tree.children) PrintTree(child, depth + 1, report);
}

void PrintStart(const StartSpec& start, const TaskReport& report) {
  report.Line("start", start.roomy() ? "space before and behind every object" : "objects where there is room");
  if (!start.keep_clear.empty())
    report.Line("", fmt::format("no obstacle at {} places around the target", start.keep_clear.size()));
  if (!start.not_already) return;
  report.Line("", "not already:");
  PrintTree(*start.not_already, 1, report);
}

// What it is to begin with, do, keep off and reach.
void PrintRules(const TaskSpec& spec, TaskReport& report) {
  if (spec.reference.needed)
    report.Line("reference", spec.reference.only.empty() ? "any other object"
                                                         : fmt::format("{}", fmt::join(spec.reference.only, ", ")));
  report.json["reference"] = {{"needed", spec.reference.needed}, {"only", spec.reference.only}};
  for (const auto& variant : spec.avoid)
    report.Line("also", fmt::format("'{}+{}': without touching {}", spec.name, variant,
                                    variant == "obstacle" ? "the obstacle" : "other objects"));
  report.json["avoid"] = spec.avoid;
  PrintStart(spec.start, report);
  auto& stages = report.json["stages"] = OrderedJson::array();
  for (const auto& stage : spec.stages) {
    report.Line(stages.empty() ? "stages" : "", StageWords(stage));
    stages.push_back(StageWords(stage));
  }
  report.Line("done", fmt::format("when for {} control steps", task::kDwell));
  PrintTree(spec.success, 1, report);
  report.json["success"] = ToJson(spec.success);
  const PredicateSpec& latched = spec.latched ? *spec.latched : spec.success;
  report.Line("latched", "when once, as the paper's authors count");
  PrintTree(latched, 1, report);
  report.json["latched"] = ToJson(latched);
}

Status PrintMeaning(const TaskName& task, const std::vector<std::string>& objects, TaskReport& report) {
  const TaskSpec& spec = *task.spec;
  report.json["task"] = task.text();
  report.json["summary"] = spec.summary;
  report.Line("task", spec.summary.empty() ? spec.name : fmt::format("{}: {}", spec.name, spec.summary));
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
  auto& said = report.json["sentences"] = OrderedJson::array();
  for (std::size_t i = 0; i < std::min<std::size_t>(kSentences, sentences.size()); ++i) {
    report.Line(i == 0 ? "sentences" : "", fmt::format("\"{}\"", sentences[i]));
    said.push_back(sentences[i]);
  }
  PrintRules(spec, report);
  return {};
}

struct Trials {
  std::vector<std::string> objects;
  int attempts;
  sim::RendererConfig renderer;
};

// How many attempts succeed; prints it.
Result<int> Try(const TaskName& task, const std::string& robot, const Trials& trials, TaskReport& report) {
  CampaignSpec spec;
  spec.robots = {robot};
  spec.tasks = {task.text()};
  ChooseObjects(*task.spec, trials.objects, spec);
  auto opened = task::AttemptRunner::Open(spec, trials.renderer);
  if (!opened && opened.error().code != Code::kInvalidArgument) return Fail(opened.error());
  if (!opened) {  // not for this robot; the others are tried all the same
    const std::string& why = opened.error().message;
    report.Line("FAILS", fmt::format("{}: {}", robot, why));
    report.json["robots"].push_back({{"robot", robot},
                                     {"attempts", 0},
                                     {"succeeded", 0},
                                     {"works", false},
                                     {"reasons", std::map<std::string, int>{{why, 1}}}});
    return 0;
  }
  task::AttemptRunner runner = std::move(*opened);
  int succeeded = 0;
  std::map<std::string, int> reasons;
  for (int index = 0; index < trials.attempts; ++index) {
    if (StopRequested())
      return Fail(Code::kExhausted, fmt::format("task check: stopped after {} of {} demonstrations with {}", index,
                                                trials.attempts, robot));
    ETUDE_ASSIGN_OR_RETURN(const auto attempt, runner.Demonstrate(static_cast<std::uint64_t>(index), 0));
    if (attempt.outcome == task::AttemptOutcome::kSuccess)
      ++succeeded;
    else
      ++reasons[fmt::format("{}: {}", task::ToString(attempt.outcome), attempt.reason)];
  }
  const bool works = 2 * succeeded > trials.attempts;
  report.Line(works ? "ok" : "FAILS",
              fmt::format("{}: {} of {} demonstrations succeed", robot, succeeded, trials.attempts));
  for (const auto& [reason, count] : reasons) report.Line("", fmt::format("  {} x {}", count, reason));
  report.json["robots"].push_back({{"robot", robot},
                                   {"attempts", trials.attempts},
                                   {"succeeded", succeeded},
                                   {"works", works},
                                   {"reasons", reasons}});
  return succeeded;
}

}  // namespace

Status CheckTaskFile(const std::string& name, const TaskCheckOptions& options, const sim::RendererConfig& renderer) {
  ETUDE_ASSIGN_OR_RETURN(const TaskName task, ParseTask(name));
  for (const std::string& robot : options.robots) ETUDE_RETURN_IF_ERROR(FindRobot(robot));
  const std::vector<std::string> objects = ObjectsFor(task);
  ETUDE_RETURN_IF_ERROR(task::CheckPredicates(*task.spec, SceneNames(objects)));
  TaskReport report(options.as_json);
  ETUDE_RETURN_IF_ERROR(PrintMeaning(task, objects, report));
  report.json["robots"] = OrderedJson::array();
  bool works = false;
  for (const std::string& robot : options.robots) {
    ETUDE_ASSIGN_OR_RETURN(const int succeeded, Try(task, robot, {objects, options.attempts, renderer}, report));
    works = works || 2 * succeeded > options.attempts;
  }
  report.End();
  if (works) return {};
  return Fail(Code::kInvalidArgument, fmt::format("task '{}' works on none of {}: the reasons are above", name,
                                                  fmt::join(options.robots, ", ")));
}

}  // namespace etude
