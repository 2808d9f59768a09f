// SPDX-License-Identifier: Apache-2.0
#include "trainer/learn/config.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

#include "services/core/config.h"
#include "trainer/policy/compose.h"
#include "trainer/policy/parts.h"
#include "trainer/policy/policy_file.h"

namespace etude::learn {
namespace {

// `freeze` stood alone before there was `init`: a run of then goes on.
void MoveFreeze(OrderedJson& json) {
  if (!json.is_object() || !json.contains("freeze") || (json.contains("init") && !json["init"].is_object())) return;
  json["init"]["freeze"] = json["freeze"];
  json.erase("freeze");
}

// What config.yaml of a run notes of where its data lay: the command line says it, or another folder.
void DropDatasets(OrderedJson& json) {
  if (json.is_object()) json.erase("datasets");
}

/// Turns names in an experiment's map into what they stand for.
class Resolver {
 public:
  Resolver(std::vector<Path> folders, const GraphReader& graph_of)
      : folders_(std::move(folders)), graph_of_(graph_of) {}

  /// The override is not yet applied: policy.a.b=c needs the policy's map.
  Status Override(OrderedJson& json, const std::string& text) const {
    if (text.starts_with("policy.")) ETUDE_RETURN_IF_ERROR(Policy(json));
    return ApplyOverride(json, text);
  }

  Status Policy(OrderedJson& json) const {
    if (!json.is_object() || !json.contains("policy") || !json["policy"].is_string()) return {};
    const auto name = json["policy"].get<std::string>();
    if (name != kCheckpoint) {
      ETUDE_ASSIGN_OR_RETURN(json["policy"], policy::ReadPolicyMap(name, folders_));
      return {};
    }
    const std::string from = FromOf(json);
    if (from.empty() || !graph_of_)
      return Fail(Code::kInvalidArgument, "policy: checkpoint: needs the file of a checkpoint, init.from");
    ETUDE_ASSIGN_OR_RETURN(json["policy"], graph_of_(from));
    return {};
  }

  Status Additions(OrderedJson& json) const {
    if (!json.is_object() || !json.contains("add")) return {};
    const OrderedJson names = json["add"].is_string() ? OrderedJson::array({json["add"]}) : json["add"];
    json.erase("add");
    if (!names.is_array() || !std::all_of(names.begin(), names.end(), [](const auto& x) { return x.is_string(); }))
      return Fail(Code::kInvalidArgument, "add: must be a list of policies' names");
    const OrderedJson before = json["policy"];
    for (const auto& name : names) ETUDE_RETURN_IF_ERROR(Add(json["policy"], name.get<std::string>()));
    // weights that are copied were trained with what their modules read then
    if (!FromOf(json).empty()) policy::KeepReads(before, json["policy"]);
    return {};
  }

 private:
  static constexpr char kCheckpoint[] = "checkpoint";

  static std::string FromOf(const OrderedJson& json) {
    const auto pointer = OrderedJson::json_pointer("/init/from");
    return json.contains(pointer) && json[pointer].is_string() ? json[pointer].get<std::string>() : "";
  }

  Status Add(OrderedJson& graph, const std::string& name) const {
    const std::string own = graph.is_object() && graph.contains("name") && graph["name"].is_string()
                                ? graph["name"].get<std::string>()
                                : policy::PolicyConfig().name;
    const std::string family = own.substr(0, own.find('/'));
    std::vector<Path> places;
    for (const auto& folder : folders_) places.push_back(folder / family);
    ETUDE_ASSIGN_OR_RETURN(const Path path, policy::FindNamedFile(name, places, fmt::format("add to '{}':", own)));
    ETUDE_ASSIGN_OR_RETURN(auto addition, policy::ReadYamlMap(path));
    addition.erase("extends");  // what it is added to is there
    ETUDE_RETURN_IF_ERROR(CheckNew(graph, addition, own, name));
    graph = policy::Compose(graph, addition);
    return {};
  }

  // an entry that says a level makes a module; others give an existing one more to read
  static Status CheckNew(const OrderedJson& graph, const OrderedJson& addition, const std::string& own,
                         const std::string& name) {
    std::vector<std::string> there;
    for (const auto& entry : policy::ModuleEntries(graph)) there.push_back(policy::EntryName(entry));
    for (const auto& entry : policy::ModuleEntries(addition)) {
      const std::string word = policy::EntryName(entry);
      if (word.empty()) continue;  // whoever reads the graph says what is wrong
      const bool makes = entry.contains("level"), known = std::ranges::find(there, word) != there.end();
      if (makes && known)
        return Fail(Code::kInvalidArgument, fmt::format("add '{}': '{}' has a module \"{}\" already", name, own, word));
      if (!makes && !known)
        return Fail(Code::kInvalidArgument,
                    fmt::format("add '{}': '{}' has no module \"{}\" to give more to, and without a level it makes "
                                "none{}",
                                name, own, word, Suggestion(word, there)));
      if (makes) there.push_back(word);
    }
    return {};
  }

  std::vector<Path> folders_;
  const GraphReader& graph_of_;
};

}  // namespace

Status TrainConfig::Validate() const {
  std::vector<std::string> errors;
  const auto require = [&](bool good, std::string message) {
    if (!good) errors.push_back(std::move(message));
  };
  // what is not finite cannot be saved either
  require(minutes >= 0 && minutes <= kMostMinutes, fmt::format("minutes: {} not in 0..{:.0f}", minutes, kMostMinutes));
  require(ema >= 0 && ema < 1, fmt::format("ema: {} not in 0..1", ema));
  require(optimizer.lr > 0, fmt::format("optimizer.lr: {} must be > 0", optimizer.lr));
  for (double beta : {optimizer.beta1, optimizer.beta2})
    require(beta >= 0 && beta < 1, fmt::format("optimizer.beta1, beta2: {} not in 0..1", beta));
  require(optimizer.epsilon > 0, "optimizer.epsilon: must be > 0");
  require(optimizer.weight_decay >= 0, "optimizer.weight_decay: must be >= 0");
  require(optimizer.warmup_steps >= 0, "optimizer.warmup_steps: must be >= 0");
  require(optimizer.schedule == "cosine" || optimizer.schedule == "constant",
          fmt::format("optimizer.schedule: '{}' is not known; known: cosine, constant", optimizer.schedule));
  require(optimizer.final_lr >= 0 && optimizer.final_lr <= 1, "optimizer.final_lr: not in 0..1");
  require(optimizer.clip >= 0, "optimizer.clip: must be >= 0");
  require(eval.every_steps >= 1 && eval.frames >= 1, "eval.every_steps, eval.frames: must be >= 1");
  require(checkpoint.every_steps >= 1 && checkpoint.keep >= 1, "checkpoint.every_steps, keep: must be >= 1");
  require(threads.replicas >= 0 && threads.replicas <= 256, "threads.replicas: not in 0..256");
  require(threads.intra_op >= 1 && threads.intra_op <= 256, "threads.intra_op: not in 1..256");
  for (const auto& [what, names] :
       {std::pair{"init.copy", &init.copy}, {"init.fresh", &init.fresh}, {"init.freeze", &init.freeze}})
    if (const auto known = policy::CheckParts(policy, what, *names); !known) errors.push_back(known.error().message);
  require(!init.from.empty() || (init.copy.empty() && init.fresh.empty() && init.like.empty()),
          "init.copy, init.fresh, init.like: need a checkpoint, init.from");
  data.Check(errors);
  curriculum.Check(errors);
  if (const auto status = policy.Validate(); !status) errors.push_back(status.error().message);
  if (errors.empty()) return {};
  return Fail(Code::kInvalidArgument, fmt::format("experiment '{}': {}", name, fmt::join(errors, "; ")));
}

Result<TrainConfig> LoadTrainConfig(const std::string& name_or_file, const Path& experiments,
                                    const std::vector<std::string>& overrides, const GraphReader& graph_of) {
  ETUDE_ASSIGN_OR_RETURN(const Path path, policy::FindNamedFile(name_or_file, {experiments}, "experiment"));
  const Resolver resolver({path.parent_path() / "policies", experiments / "policies"}, graph_of);
  ETUDE_ASSIGN_OR_RETURN(OrderedJson json, policy::ReadYamlMap(path));
  MoveFreeze(json);  // what is said of init.freeze beside the file comes after it
  for (const auto& text : overrides) ETUDE_RETURN_IF_ERROR(resolver.Override(json, text));
  ETUDE_RETURN_IF_ERROR(resolver.Policy(json));
  ETUDE_RETURN_IF_ERROR(resolver.Additions(json));
  MoveFreeze(json);
  DropDatasets(json);
  if (json.is_object() && json.contains("policy")) policy::WriteOutLanguage(json["policy"]);
  ETUDE_ASSIGN_OR_RETURN(auto config, FromJson<TrainConfig>(json, path.string()));
  ETUDE_RETURN_IF_ERROR(config.Validate());
  return config;
}

}  // namespace etude::learn
