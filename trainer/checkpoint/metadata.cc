// SPDX-License-Identifier: Apache-2.0
#include "trainer/checkpoint/metadata.h"

#include <fmt/format.h>

#include <charconv>
#include <cmath>

#include "services/core/command.h"
#include "trainer/checkpoint/readiness.h"
#include "trainer/checkpoint/schema.h"
#include "trainer/checkpoint/sizes.h"
#include "trainer/policy/architecture.h"
#include "trainer/policy/crop.h"

namespace etude::checkpoint {
namespace {

using Text = std::map<std::string, std::string>;

Result<std::string> Find(const Text& text, const char* key) {
  const auto it = text.find(key);
  if (it == text.end()) return Fail(Code::kCorrupt, fmt::format("checkpoint: metadata has no '{}'", key));
  return it->second;
}

template <class Number>
Status Read(const Text& text, const char* key, Number& number) {
  ETUDE_ASSIGN_OR_RETURN(const std::string value, Find(text, key));
  const auto [end, error] = std::from_chars(value.data(), value.data() + value.size(), number);
  if (error == std::errc() && end == value.data() + value.size()) return {};
  return Fail(Code::kCorrupt, fmt::format("checkpoint: metadata '{}' is '{:.100}', not a number", key, value));
}

template <class Config>
Result<Config> ReadConfig(const Text& text, const char* key) {
  ETUDE_ASSIGN_OR_RETURN(const OrderedJson json, ReadMap(text, key));
  auto config = FromJson<Config>(json, fmt::format("checkpoint: {}", key));
  if (!config) return Fail(Code::kCorrupt, config.error().message);
  return config;
}

Status ReadMetrics(const OrderedJson& json, std::map<std::string, double>& metrics) {
  for (const auto& [name, value] : json.items()) {
    if (!value.is_number() && !value.is_null())
      return Fail(Code::kCorrupt, fmt::format("checkpoint: metadata 'metrics': '{:.100}' is not a number", name));
    metrics[name] = value.is_null() ? std::nan("") : value.get<double>();
  }
  return {};
}

Result<policy::PolicyConfig> ReadPolicy(const Text& text) {
  ETUDE_ASSIGN_OR_RETURN(const OrderedJson said, ReadMap(text, "policy_config"));
  ETUDE_ASSIGN_OR_RETURN(const std::string architecture, Find(text, "architecture"));
  const std::string own = policy::ArchitectureHash(said);
  if (own != architecture)
    return Fail(Code::kCorrupt, fmt::format("checkpoint: architecture {:.12} is named, but its policy_config makes "
                                            "{:.12}",
                                            architecture, own));
  ETUDE_ASSIGN_OR_RETURN(auto policy, ReadConfig<policy::PolicyConfig>(text, "policy_config"));
  if (const auto valid = policy.Validate(); !valid) return Fail(Code::kCorrupt, "checkpoint: " + valid.error().message);
  return policy;
}

// what later code allocates from
Status CheckEmbodiment(const Metadata& metadata) {
  const Embodiment& fits = metadata.embodiment;
  const auto in_range = [](int x, int low, int high) { return x >= low && x <= high; };
  if (!in_range(fits.joints, 1, kMaxJoints))
    return Fail(Code::kCorrupt, fmt::format("checkpoint: metadata 'embodiment': {} joints", fits.joints));
  if (!in_range(fits.width, 0, kMaxPicture) || !in_range(fits.height, 0, kMaxPicture))
    return Fail(Code::kCorrupt,
                fmt::format("checkpoint: metadata 'embodiment': pictures of {}x{} px", fits.width, fits.height));
  return {};
}

}  // namespace

OrderedJson ModulesToJson(const std::map<std::string, ModuleRecord>& modules) {
  OrderedJson json = OrderedJson::object();
  for (const auto& [name, record] : modules) {
    json[name] = {{"trained_steps", record.trained_steps}};
    json[name]["error"] = record.error ? OrderedJson(*record.error) : OrderedJson(nullptr);
  }
  return json;
}

Result<std::map<std::string, ModuleRecord>> ModulesFromJson(const OrderedJson& json) {
  if (!json.is_object()) return Fail(Code::kCorrupt, "checkpoint: modules is not a map");
  std::map<std::string, ModuleRecord> modules;
  for (const auto& [name, item] : json.items()) {
    const auto bad = [&] {
      return Fail(Code::kCorrupt, fmt::format("checkpoint: modules: '{:.100}' is not "
                                              "{{trained_steps, error}}",
                                              name));
    };
    if (!item.is_object() || !item.contains("trained_steps") || !item["trained_steps"].is_number_unsigned())
      return bad();
    ModuleRecord record{item["trained_steps"].get<std::uint64_t>(), std::nullopt};
    if (item.contains("error") && !item["error"].is_null()) {
      if (!item["error"].is_number()) return bad();
      record.error = item["error"].get<double>();
    }
    modules[name] = record;
  }
  return modules;
}

std::map<std::string, std::string> ToText(const Metadata& metadata) {
  const OrderedJson said = policy::SaidOf(metadata.policy);
  return {{"format", FormatOf(kSchema)},
          {"version", Version()},
          {"run", metadata.run},
          {"step", std::to_string(metadata.step)},
          {"stage", std::to_string(metadata.stage)},
          {"stages", std::to_string(metadata.stages)},
          {"stage_name", metadata.stage_name},
          {"best", metadata.best ? "1" : "0"},
          {"train_episodes", std::to_string(metadata.train_episodes)},
          {"dataset", metadata.dataset},
          {"words", metadata.words},
          {"architecture", policy::ArchitectureHash(said)},
          {"embodiment", ToJson(metadata.embodiment).dump()},
          {"modules", ModulesToJson(metadata.modules).dump()},
          {"metrics", OrderedJson(metadata.metrics).dump()},
          {"policy_config", said.dump()},
          {"train_config", metadata.train_config.dump()},
          // for people who look into the file; readers ask readiness.h
          {"refused", WhyUntrained(metadata)}};
}

Result<Metadata> FromText(const std::map<std::string, std::string>& text) {
  Metadata metadata;
  int best = 0;
  ETUDE_ASSIGN_OR_RETURN(metadata.run, Find(text, "run"));
  ETUDE_ASSIGN_OR_RETURN(metadata.version, Find(text, "version"));
  ETUDE_ASSIGN_OR_RETURN(metadata.stage_name, Find(text, "stage_name"));
  ETUDE_ASSIGN_OR_RETURN(metadata.dataset, Find(text, "dataset"));
  ETUDE_RETURN_IF_ERROR(Read(text, "step", metadata.step));
  ETUDE_RETURN_IF_ERROR(Read(text, "stage", metadata.stage));
  ETUDE_RETURN_IF_ERROR(Read(text, "stages", metadata.stages));
  ETUDE_RETURN_IF_ERROR(Read(text, "best", best));
  ETUDE_RETURN_IF_ERROR(Read(text, "train_episodes", metadata.train_episodes));
  metadata.best = best != 0;
  if (const auto words = text.find("words"); words != text.end()) metadata.words = words->second;
  ETUDE_ASSIGN_OR_RETURN(metadata.embodiment, ReadConfig<Embodiment>(text, "embodiment"));
  ETUDE_ASSIGN_OR_RETURN(const OrderedJson modules, ReadMap(text, "modules"));
  ETUDE_ASSIGN_OR_RETURN(metadata.modules, ModulesFromJson(modules));
  ETUDE_ASSIGN_OR_RETURN(const OrderedJson metrics, ReadMap(text, "metrics"));
  ETUDE_RETURN_IF_ERROR(ReadMetrics(metrics, metadata.metrics));
  ETUDE_ASSIGN_OR_RETURN(metadata.train_config, ReadMap(text, "train_config"));
  ETUDE_ASSIGN_OR_RETURN(metadata.policy, ReadPolicy(text));
  ETUDE_RETURN_IF_ERROR(CheckEmbodiment(metadata));
  return metadata;
}

OrderedJson GraphOf(const Metadata& metadata) {
  OrderedJson graph = policy::SaidOf(metadata.policy);
  const auto& fits = metadata.embodiment;
  if (fits.camera_pose.size() != 7 || fits.fovy <= 0) return graph;
  const auto& pose = fits.camera_pose;
  Camera camera{.width = fits.width, .height = fits.height, .fovy = fits.fovy};
  camera.X_WC = {{pose[0], pose[1], pose[2]}, {pose[3], pose[4], pose[5], pose[6]}};
  policy::ImageConfig derived = metadata.policy.image;
  derived.crop.clear();
  const auto crop = policy::ResolveCrop(derived, camera);
  if (crop && policy::ToNumbers(*crop) == metadata.policy.image.crop) graph["image"].erase("crop");
  return graph;
}

OrderedJson Summary(const Metadata& metadata) {
  return {{"run", metadata.run},
          {"step", metadata.step},
          {"stage", metadata.stage},
          {"stages", metadata.stages},
          {"name", metadata.stage_name},
          {"best", metadata.best},
          {"version", metadata.version},
          {"architecture", policy::ArchitectureHash(metadata.policy)},
          {"embodiment", ToJson(metadata.embodiment)},
          {"modules", ModulesToJson(metadata.modules)},
          {"refused", WhyUntrained(metadata)},
          {"metrics", metadata.metrics}};
}

}  // namespace etude::checkpoint
