// SPDX-License-Identifier: Apache-2.0
#include "trainer/learn/config.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

namespace etude::learn {
namespace {

namespace fs = std::filesystem;

std::vector<std::string> NamesIn(const Path& folder) {
  std::vector<std::string> names;
  std::error_code ignored;
  for (const auto& item : fs::directory_iterator(folder, ignored))
    if (item.path().extension() == ".yaml") names.push_back(item.path().stem());
  std::sort(names.begin(), names.end());
  return names;
}

Result<Path> ResolveFile(const std::string& name_or_file, const std::vector<Path>& folders, const char* what) {
  std::error_code ignored;
  if (fs::is_regular_file(name_or_file, ignored)) return Path(name_or_file);
  std::vector<std::string> known;
  for (const auto& folder : folders) {
    const Path path = folder / (name_or_file + ".yaml");
    if (fs::is_regular_file(path, ignored)) return path;
    for (auto& name : NamesIn(folder)) known.push_back(std::move(name));
  }
  const std::string nearest = NearestMatch(name_or_file, known);
  return Fail(Code::kInvalidArgument, fmt::format("{} '{}': neither a file nor a name{}; names: {}", what, name_or_file,
                                                  nearest.empty() ? "" : fmt::format(" (did you mean '{}'?)", nearest),
                                                  fmt::join(known, ", ")));
}

Result<OrderedJson> ReadYamlMap(const Path& path) {
  ETUDE_ASSIGN_OR_RETURN(const std::string text, ReadTextFile(path, 1 << 20));
  ETUDE_ASSIGN_OR_RETURN(auto json, ParseYaml(text, path.string()));
  if (json.is_null()) json = OrderedJson::object();
  return json;
}

// `policy: NAME` becomes the policy's own map
Status ResolvePolicy(OrderedJson& json, const std::vector<Path>& folders) {
  if (!json.is_object() || !json.contains("policy") || !json["policy"].is_string()) return {};
  ETUDE_ASSIGN_OR_RETURN(const Path path, ResolveFile(json["policy"].get<std::string>(), folders, "policy"));
  ETUDE_ASSIGN_OR_RETURN(json["policy"], ReadYamlMap(path));
  return {};
}

}  // namespace

Status TrainConfig::Validate() const {
  std::vector<std::string> errors;
  const auto require = [&](bool good, std::string message) {
    if (!good) errors.push_back(std::move(message));
  };
  require(minutes >= 0, fmt::format("minutes: {} must be >= 0", minutes));
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
  for (const auto& name : freeze)
    require(std::any_of(policy.modules.begin(), policy.modules.end(), [&](const auto& m) { return m.name == name; }),
            fmt::format("freeze: the policy has no module '{}'", name));
  data.Check(errors);
  curriculum.Check(errors);
  if (const auto status = policy.Validate(); !status) errors.push_back(status.error().message);
  if (errors.empty()) return {};
  return Fail(Code::kInvalidArgument, fmt::format("experiment '{}': {}", name, fmt::join(errors, "; ")));
}

Result<TrainConfig> LoadTrainConfig(const std::string& name_or_file, const Path& experiments,
                                    const std::vector<std::string>& overrides) {
  ETUDE_ASSIGN_OR_RETURN(const Path path, ResolveFile(name_or_file, {experiments}, "experiment"));
  const std::vector<Path> folders{path.parent_path() / "policies", experiments / "policies"};
  ETUDE_ASSIGN_OR_RETURN(OrderedJson json, ReadYamlMap(path));
  ETUDE_RETURN_IF_ERROR(ResolvePolicy(json, folders));
  for (const auto& text : overrides) {
    ETUDE_RETURN_IF_ERROR(ApplyOverride(json, text));
    ETUDE_RETURN_IF_ERROR(ResolvePolicy(json, folders));
  }
  ETUDE_ASSIGN_OR_RETURN(auto config, FromJson<TrainConfig>(json, path.string()));
  ETUDE_RETURN_IF_ERROR(config.Validate());
  return config;
}

Result<Path> FindExperiments(const std::string& share, const Path& executable) {
  std::error_code ignored;
  if (!share.empty()) {
    if (fs::is_directory(Path(share) / "experiments", ignored)) return Path(share) / "experiments";
    return Fail(Code::kNotFound, fmt::format("ETUDE_SHARE is '{}', which has no folder 'experiments'", share));
  }
  for (Path folder = fs::absolute(executable, ignored).parent_path();; folder = folder.parent_path()) {
    for (const char* name : {"trainer/experiments", "share/etude/experiments"})
      if (fs::is_directory(folder / name, ignored)) return folder / name;
    if (folder == folder.parent_path()) break;
  }
  return Fail(Code::kNotFound,
              fmt::format("no trainer/experiments above '{}': set ETUDE_SHARE to the folder that has 'experiments'",
                          executable.string()));
}

}  // namespace etude::learn
