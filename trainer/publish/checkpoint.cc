// SPDX-License-Identifier: Apache-2.0
#include "trainer/publish/checkpoint.h"

#include <fmt/format.h>

#include <charconv>

#include "services/core/command.h"
#include "services/store/safetensors.h"
#include "trainer/learn/tensors.h"

namespace etude::publish {
namespace {

constexpr char kFormat[] = "etude checkpoint 1";

class Metadata {
 public:
  explicit Metadata(const std::map<std::string, std::string>& values) : values_(values) {}

  Result<std::string> Text(const char* key) const {
    const auto it = values_.find(key);
    if (it == values_.end()) return Fail(Code::kCorrupt, fmt::format("checkpoint: metadata has no '{}'", key));
    return it->second;
  }
  template <class Number>
  Status Read(const char* key, Number& number) const {
    ETUDE_ASSIGN_OR_RETURN(const std::string text, Text(key));
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
    if (error == std::errc() && end == text.data() + text.size()) return {};
    return Fail(Code::kCorrupt, fmt::format("checkpoint: metadata '{}' is '{}', not a number", key, text));
  }
  Result<OrderedJson> ReadJson(const char* key) const {
    ETUDE_ASSIGN_OR_RETURN(const std::string text, Text(key));
    auto json = OrderedJson::parse(text, nullptr, false);
    if (json.is_discarded()) return Fail(Code::kCorrupt, fmt::format("checkpoint: metadata '{}' is not JSON", key));
    return json;
  }

 private:
  const std::map<std::string, std::string>& values_;
};

Result<CheckpointInfo> ReadInfo(const Metadata& metadata) {
  CheckpointInfo info;
  ETUDE_ASSIGN_OR_RETURN(info.run, metadata.Text("run"));
  ETUDE_ASSIGN_OR_RETURN(info.version, metadata.Text("version"));
  ETUDE_ASSIGN_OR_RETURN(info.stage_name, metadata.Text("stage_name"));
  ETUDE_ASSIGN_OR_RETURN(info.dataset, metadata.Text("dataset"));
  ETUDE_ASSIGN_OR_RETURN(info.architecture, metadata.Text("architecture"));
  ETUDE_RETURN_IF_ERROR(metadata.Read("step", info.step));
  ETUDE_RETURN_IF_ERROR(metadata.Read("stage", info.stage));
  ETUDE_RETURN_IF_ERROR(metadata.Read("stages", info.stages));
  ETUDE_RETURN_IF_ERROR(metadata.Read("train_episodes", info.train_episodes));
  ETUDE_RETURN_IF_ERROR(metadata.Read("joints", info.joints));
  ETUDE_ASSIGN_OR_RETURN(info.metrics, metadata.ReadJson("metrics"));
  ETUDE_ASSIGN_OR_RETURN(info.train_config, metadata.ReadJson("train_config"));
  if (info.joints < 1 || info.joints > 1000)
    return Fail(Code::kCorrupt, fmt::format("checkpoint: {} joints", info.joints));
  return info;
}

}  // namespace

Result<std::vector<std::uint8_t>> EncodeCheckpoint(const learn::CheckpointRequest& request, const std::string& run) {
  store::Safetensors file;
  for (const auto& [name, tensor] : request.tensors) {
    ETUDE_ASSIGN_OR_RETURN(file.tensors[name], learn::ToStore(tensor));
  }
  file.metadata = {{"format", kFormat},
                   {"version", Version()},
                   {"run", run},
                   {"step", std::to_string(request.step)},
                   {"stage", std::to_string(request.stage)},
                   {"stages", std::to_string(request.stages)},
                   {"stage_name", request.stage_name},
                   {"train_episodes", std::to_string(request.train_episodes)},
                   {"dataset", request.dataset},
                   {"joints", std::to_string(request.joints)},
                   {"architecture", policy::ArchitectureHash(request.config->policy)},
                   {"metrics", OrderedJson(request.metrics).dump()},
                   {"policy_config", ToJson(request.config->policy).dump()},
                   {"train_config", ToJson(*request.config).dump()}};
  return store::EncodeSafetensors(file);
}

Result<Checkpoint> DecodeCheckpoint(std::span<const std::uint8_t> bytes) {
  ETUDE_ASSIGN_OR_RETURN(const auto file, store::DecodeSafetensors(bytes));
  const Metadata metadata(file.metadata);
  const auto format = metadata.Text("format");
  if (!format || *format != kFormat)
    return Fail(Code::kCorrupt, fmt::format("checkpoint: format is '{}', expected '{}': a safetensors file, but not "
                                            "a checkpoint of this program",
                                            format.value_or("missing"), kFormat));
  ETUDE_ASSIGN_OR_RETURN(const std::string version, metadata.Text("version"));
  if (version != Version())
    return Fail(
        Code::kInvalidArgument,
        fmt::format("checkpoint: version {} wrote it, this is {}; use the program that fits", version, Version()));
  Checkpoint checkpoint;
  ETUDE_ASSIGN_OR_RETURN(checkpoint.info, ReadInfo(metadata));
  ETUDE_ASSIGN_OR_RETURN(const auto config, metadata.ReadJson("policy_config"));
  auto policy = FromJson<policy::PolicyConfig>(config, "checkpoint: policy_config");
  if (!policy) return Fail(Code::kCorrupt, policy.error().message);
  if (const auto valid = policy->Validate(); !valid)
    return Fail(Code::kCorrupt, "checkpoint: " + valid.error().message);
  const std::string architecture = policy::ArchitectureHash(*policy);
  if (architecture != checkpoint.info.architecture)
    return Fail(Code::kCorrupt, fmt::format("checkpoint: architecture {:.12} is named, but its config makes {:.12}",
                                            checkpoint.info.architecture, architecture));
  checkpoint.policy = std::move(*policy);
  for (const auto& [name, tensor] : file.tensors) checkpoint.tensors[name] = learn::FromStore(tensor);
  return checkpoint;
}

Result<Checkpoint> ReadCheckpoint(const Path& path) {
  ETUDE_ASSIGN_OR_RETURN(const auto bytes, ReadBinaryFile(path));
  auto checkpoint = DecodeCheckpoint(bytes);
  if (!checkpoint) return Fail(checkpoint.error().Wrap(fmt::format("read '{}'", path.string())));
  return checkpoint;
}

Result<std::shared_ptr<policy::Policy>> BuildPolicy(const Checkpoint& checkpoint) {
  const auto unit = policy::Normalization::Unit(checkpoint.info.joints);  // the checkpoint brings the real one
  try {
    ETUDE_ASSIGN_OR_RETURN(auto policy, policy::Policy::Create(checkpoint.policy, unit, 0));
    if (const auto loaded = policy->LoadStateTensors(checkpoint.tensors); !loaded)
      return Fail(Code::kCorrupt, "checkpoint: " + loaded.error().message);
    policy->eval();
    return policy;
  } catch (const c10::Error& error) {
    return Fail(Code::kCorrupt, fmt::format("checkpoint: {}", error.what_without_backtrace()));
  }
}

}  // namespace etude::publish
