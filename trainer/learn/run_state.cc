// SPDX-License-Identifier: Apache-2.0
#include "trainer/learn/run_state.h"

#include <fmt/format.h>

#include <cmath>
#include <limits>

#include "services/core/command.h"
#include "services/store/safetensors.h"
#include "trainer/checkpoint/tensors.h"

namespace etude::learn {
namespace {

constexpr std::string_view kPrefix = "etude training state ";
constexpr char kFormat[] = "etude training state 2";

Status PutTensors(const std::string& prefix, const std::map<std::string, torch::Tensor>& tensors,
                  store::Safetensors& file) {
  for (const auto& [name, tensor] : tensors) {
    ETUDE_ASSIGN_OR_RETURN(file.tensors[prefix + name], checkpoint::ToStore(tensor));
  }
  return {};
}

// JSON has no NaN
OrderedJson MeasuredToJson(const std::map<std::string, double>& metrics) {
  OrderedJson json = OrderedJson::object();
  for (const auto& [name, value] : metrics) json[name] = std::isfinite(value) ? OrderedJson(value) : OrderedJson();
  return json;
}

std::map<std::string, double> MeasuredFromJson(const OrderedJson& json) {
  std::map<std::string, double> metrics;
  for (const auto& [name, value] : json.items())
    metrics[name] = value.is_null() ? std::numeric_limits<double>::quiet_NaN() : value.get<double>();
  return metrics;
}

}  // namespace

Status SaveRunState(const Path& path, const RunState& state) {
  store::Safetensors file;
  ETUDE_RETURN_IF_ERROR(PutTensors("policy.", state.policy, file));
  ETUDE_RETURN_IF_ERROR(PutTensors("optimizer.", state.optimizer, file));
  ETUDE_RETURN_IF_ERROR(PutTensors("", {{"rng", state.rng}}, file));
  OrderedJson run{{"step", state.step},
                  {"elapsed_s", state.elapsed_s},
                  {"limit", state.limit},
                  {"curriculum", state.curriculum},
                  {"architecture", state.architecture},
                  {"embodiment", ToJson(state.embodiment)},
                  {"modules", checkpoint::ModulesToJson(state.modules)},
                  {"words", state.words},
                  {"validation", state.validation},
                  {"replicas", state.replicas},
                  {"best_stage", state.best_stage},
                  {"best_score", state.best_score},
                  {"checkpoint_step", state.checkpoint_step},
                  {"metrics", MeasuredToJson(state.metrics)}};
  if (!state.datasets.empty()) run["datasets"] = state.datasets;
  file.metadata = {{"format", kFormat}, {"version", Version()}, {"run", run.dump()}};
  return store::WriteSafetensors(path, file);
}

namespace {

void TakeTensors(const store::Safetensors& file, RunState& state) {
  for (const auto& [name, tensor] : file.tensors) {
    if (name.starts_with("policy."))
      state.policy[name.substr(7)] = checkpoint::FromStore(tensor);
    else if (name.starts_with("optimizer."))
      state.optimizer[name.substr(10)] = checkpoint::FromStore(tensor);
    else if (name == "rng")
      state.rng = checkpoint::FromStore(tensor);
  }
}

}  // namespace

Result<RunState> LoadRunState(const Path& path) {
  ETUDE_ASSIGN_OR_RETURN(const auto file, store::ReadSafetensors(path));
  const auto meta = [&](const char* key) {
    const auto it = file.metadata.find(key);
    return it == file.metadata.end() ? std::string() : it->second;
  };
  if (!meta("format").starts_with(kPrefix))
    return Fail(Code::kCorrupt, fmt::format("'{}' is not a training state", path.string()));
  if (meta("format") != kFormat)
    return Fail(
        Code::kInvalidArgument,
        fmt::format("'{}' is an '{}' of version {}, this program goes on with '{}'; its checkpoints can be used, "
                    "but training begins anew",
                    path.string(), meta("format"), meta("version"), kFormat));
  RunState state;
  TakeTensors(file, state);
  try {
    const auto run = OrderedJson::parse(meta("run"));
    state.step = run.at("step");
    state.elapsed_s = run.at("elapsed_s");
    state.curriculum = run.at("curriculum");
    state.limit = run.at("limit");
    state.architecture = run.at("architecture");
    ETUDE_ASSIGN_OR_RETURN(state.embodiment,
                           FromJson<checkpoint::Embodiment>(run.at("embodiment"), path.string() + ": embodiment"));
    ETUDE_ASSIGN_OR_RETURN(state.modules, checkpoint::ModulesFromJson(run.at("modules")));
    state.words = run.value("words", std::string());
    state.validation = run.at("validation").get<std::vector<std::uint64_t>>();
    state.datasets = run.value("datasets", std::vector<std::string>());
    state.replicas = run.value("replicas", 0);
    state.best_stage = run.at("best_stage");
    state.best_score = run.at("best_score");
    state.checkpoint_step = run.at("checkpoint_step");
    state.metrics = MeasuredFromJson(run.value("metrics", OrderedJson::object()));
  } catch (const nlohmann::json::exception& error) {
    return Fail(Code::kCorrupt, fmt::format("'{}': {}", path.string(), error.what()));
  }
  return state;
}

}  // namespace etude::learn
