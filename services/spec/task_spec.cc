// SPDX-License-Identifier: Apache-2.0
#include "services/spec/task_spec.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <set>

#include "services/core/check.h"
#include "services/core/hash.h"
#include "services/spec/object_names.h"
#include "services/spec/task_rules.h"

namespace etude {
namespace {

constexpr std::array<std::pair<std::string_view, Whereto>, 7> kWheretos{{{"here", Whereto::kHere},
                                                                         {"left", Whereto::kLeft},
                                                                         {"right", Whereto::kRight},
                                                                         {"front", Whereto::kFront},
                                                                         {"behind", Whereto::kBehind},
                                                                         {"on_top", Whereto::kOnTop},
                                                                         {"inside", Whereto::kInside}}};

Whereto WheretoOf(const std::string& to) {
  const auto it =
      std::find_if(kWheretos.begin(), kWheretos.end(), [&](const auto& place) { return place.first == to; });
  ETUDE_CHECK(it != kWheretos.end(), "to={}", to);
  return it->second;
}

// The keys of a file.
struct StartKeys {
  std::string boxes = StartSpec{}.boxes;
  OrderedJson not_already;
  std::vector<std::vector<double>> keep_clear;

  void Visit(auto& v) {
    v("boxes", boxes, "", "standard | roomy: space before and behind every object");
    v("not_already", not_already, "", "predicate that must not hold at the start");
    v("keep_clear", keep_clear, "m", "x and y from the target, pairs: no obstacle stands there");
  }
};

struct TaskKeys {
  std::string name, summary;
  TaskWordsSpec words;
  ReferenceSpec reference;
  std::vector<std::string> avoid;
  StartKeys start;
  std::vector<OrderedJson> stages;
  OrderedJson success, latched;

  void Visit(auto& v) {
    v("name", name, "", "plain name; of a built-in task its file's");
    v("summary", summary, "", "one sentence for people");
    v("words", words, "", "of its sentences");
    v("reference", reference, "", "the second object that it is about");
    v("avoid", avoid, "", "variants besides the plain one: obstacle, others");
    v("start", start, "", "the scenes in which it starts");
    v("stages", stages, "", "primitives, one after another");
    v("success", success, "", "predicate tree: done, strictly");
    v("latched", latched, "", "predicate tree: done once, as the authors of the paper count");
  }
};

std::string SuggestionOrAll(const std::string& word, const std::vector<std::string>& known) {
  const std::string suggestion = Suggestion(word, known);
  return suggestion.empty() ? fmt::format("; known: {}", fmt::join(known, ", ")) : suggestion;
}

// Tries each primitive in turn; false when none has this name.
template <std::size_t... I>
bool ReadPrimitive(const std::string& name, const OrderedJson& parameters, const std::string& where, StageSpec& stage,
                   std::vector<std::string>& errors, std::index_sequence<I...>) {
  const auto read = [&]<class T>(T primitive) {
    if (T::kName != name) return false;
    auto parsed = FromJson<T>(parameters, where);
    if (!parsed)
      errors.push_back(parsed.error().message);
    else
      primitive = *parsed;
    stage = primitive;
    return true;
  };
  return (read(std::variant_alternative_t<I, StageSpec>{}) || ...);
}

// `reach`, or `lift: {room: 0.2}`.
void ReadStage(const OrderedJson& json, const std::string& where, std::vector<StageSpec>& stages,
               std::vector<std::string>& errors) {
  const bool named = json.is_string(), with_parameters = json.is_object() && json.size() == 1;
  if (!named && !with_parameters) {
    errors.push_back(where + ": expected a primitive, as `reach` or `lift: {room: 0.1}`");
    return;
  }
  const std::string name = named ? json.get<std::string>() : json.begin().key();
  OrderedJson parameters = named ? OrderedJson::object() : json.begin().value();
  if (parameters.is_null()) parameters = OrderedJson::object();
  StageSpec stage;
  if (ReadPrimitive(name, parameters, where + "." + name, stage, errors,
                    std::make_index_sequence<std::variant_size_v<StageSpec>>()))
    stages.push_back(stage);
  else
    errors.push_back(
        fmt::format("{}: no primitive is called '{}'{}", where, name, SuggestionOrAll(name, PrimitiveNames())));
}

}  // namespace

Whereto CarrySpec::whereto() const { return WheretoOf(to); }
Whereto PlaceSpec::whereto() const { return WheretoOf(to); }

std::string_view NameOf(const StageSpec& stage) {
  return std::visit([](const auto& primitive) { return std::decay_t<decltype(primitive)>::kName; }, stage);
}

const std::vector<std::string>& PrimitiveNames() {
  static const std::vector<std::string> names = []<std::size_t... I>(std::index_sequence<I...>) {
    return std::vector<std::string>{std::string(std::variant_alternative_t<I, StageSpec>::kName)...};
  }
  (std::make_index_sequence<std::variant_size_v<StageSpec>>());
  return names;
}

const std::vector<std::string>& WheretoNames() {
  static const std::vector<std::string> names = [] {
    std::vector<std::string> all;
    for (const auto& [name, whereto] : kWheretos) all.emplace_back(name);
    return all;
  }();
  return names;
}

bool TaskSpec::Has(std::string_view primitive) const {
  return std::any_of(stages.begin(), stages.end(), [&](const auto& stage) { return NameOf(stage) == primitive; });
}

namespace {

std::optional<PredicateSpec> ReadTree(const OrderedJson& json, const std::string& where,
                                      std::vector<std::string>& errors) {
  if (json.is_null()) return std::nullopt;
  auto tree = PredicateFromJson(json, where);
  if (tree) return *tree;
  errors.push_back(tree.error().message);
  return std::nullopt;
}

TaskSpec Read(const TaskKeys& keys, std::vector<std::string>& errors) {
  TaskSpec task{.name = keys.name,
                .summary = keys.summary,
                .words = keys.words,
                .reference = keys.reference,
                .avoid = keys.avoid,
                .start = {.boxes = keys.start.boxes, .keep_clear = keys.start.keep_clear}};
  for (std::size_t i = 0; i < keys.stages.size(); ++i)
    ReadStage(keys.stages[i], fmt::format("stages[{}]", i), task.stages, errors);
  task.start.not_already = ReadTree(keys.start.not_already, "start.not_already", errors);
  task.latched = ReadTree(keys.latched, "latched", errors);
  const auto success = ReadTree(keys.success, "success", errors);
  if (success) task.success = *success;
  return task;
}

// Everything that an episode or a sentence depends on; the stages' defaults filled in, predicates as written.
std::string HashOf(const TaskSpec& task, TaskKeys keys) {
  for (std::size_t i = 0; i < task.stages.size(); ++i) {
    OrderedJson parameters = std::visit([](const auto& primitive) { return ToJson(primitive); }, task.stages[i]);
    keys.stages[i] = OrderedJson{{std::string(NameOf(task.stages[i])), std::move(parameters)}};
  }
  keys.summary.clear();
  keys.success = ToJson(task.success);
  keys.latched = task.latched ? ToJson(*task.latched) : OrderedJson();
  keys.start.not_already = task.start.not_already ? ToJson(*task.start.not_already) : OrderedJson();
  return Sha256Hex(ToJson(keys).dump());
}

}  // namespace

bool TaskSpec::MayRefer(const std::string& target, const std::string& object) const {
  const std::string called = SceneName(object), noun = ObjectNoun(object);
  // of a path only the folder's name counts: it may be written in another way, and scenes and data sets do not have it
  const bool allowed = reference.only.empty() || std::ranges::any_of(reference.only, [&](const std::string& one) {
                         return SceneName(one) == called || one == noun;
                       });
  return reference.needed && noun != ObjectNoun(target) && allowed;
}

Result<TaskSpec> ParseTaskSpec(const OrderedJson& json, const std::string& origin) {
  TaskKeys keys;
  std::vector<std::string> errors;
  internal::ReadValue(json, "", keys, errors);
  TaskSpec task = Read(keys, errors);
  // with keys that cannot be read, the rest would be about what was left out
  if (errors.empty()) errors = ProblemsOf(task);
  if (keys.success.is_null()) errors.push_back("success: when is it done? A predicate, as `{risen: {by: 3 cm}}`");
  if (!errors.empty()) return Fail(internal::ConfigError(origin, errors));
  task.sha256 = HashOf(task, std::move(keys));
  return task;
}

Result<TaskSpec> LoadTaskSpec(const Path& file) {
  ETUDE_ASSIGN_OR_RETURN(const std::string text, ReadTextFile(file, 1 << 16));
  ETUDE_ASSIGN_OR_RETURN(OrderedJson json, ParseYaml(text, file.string()));
  if (json.is_null()) json = OrderedJson::object();
  return ParseTaskSpec(json, file.string());
}

}  // namespace etude
