// SPDX-License-Identifier: Apache-2.0
#include "trainer/checkpoint/checkpoint.h"

#include <fmt/format.h>

#include "services/store/safetensors.h"
#include "trainer/checkpoint/schema.h"
#include "trainer/checkpoint/sizes.h"
#include "trainer/checkpoint/tensors.h"
#include "trainer/policy/torch_error.h"

namespace etude::checkpoint {

Result<std::vector<std::uint8_t>> Encode(const Checkpoint& checkpoint) {
  store::Safetensors file;
  for (const auto& [name, tensor] : checkpoint.tensors) {
    ETUDE_ASSIGN_OR_RETURN(file.tensors[name], ToStore(tensor));
  }
  file.metadata = ToText(checkpoint.metadata);
  return store::EncodeSafetensors(file);
}

Result<Checkpoint> Decode(std::span<const std::uint8_t> bytes) {
  ETUDE_ASSIGN_OR_RETURN(auto file, store::DecodeSafetensors(bytes));
  ETUDE_ASSIGN_OR_RETURN(const int schema, SchemaOf(file.metadata));
  Checkpoint checkpoint;
  std::uint64_t numbers = 0;
  for (const auto& [name, tensor] : file.tensors) {
    checkpoint.tensors[name] = FromStore(tensor);
    numbers += static_cast<std::uint64_t>(checkpoint.tensors[name].numel());
  }
  ETUDE_RETURN_IF_ERROR(Upgrade(schema, file.metadata, checkpoint.tensors));
  ETUDE_ASSIGN_OR_RETURN(checkpoint.metadata, FromText(file.metadata));
  ETUDE_RETURN_IF_ERROR(CheckSizes(checkpoint.metadata.policy, checkpoint.metadata.embodiment.joints, numbers));
  return checkpoint;
}

Result<Checkpoint> ReadFile(const Path& path) {
  ETUDE_ASSIGN_OR_RETURN(const auto bytes, ReadBinaryFile(path));
  auto checkpoint = Decode(bytes);
  if (!checkpoint) return Fail(checkpoint.error().Wrap(fmt::format("read '{}'", path.string())));
  return checkpoint;
}

Result<std::shared_ptr<policy::Policy>> BuildPolicy(const Checkpoint& checkpoint, clip::Folders* folders) {
  const auto& metadata = checkpoint.metadata;
  const auto& language = metadata.policy.language;
  const auto unit = policy::Normalization::Unit(metadata.embodiment.joints);  // the checkpoint brings the real one
  try {
    std::shared_ptr<clip::TextEncoder> text_encoder;
    if (folders && !language.clip_folder().empty()) {
      ETUDE_ASSIGN_OR_RETURN(text_encoder, folders->Open(language.clip_folder(), language.sha256));
    }
    ETUDE_ASSIGN_OR_RETURN(auto policy, policy::Policy::Create(metadata.policy, unit, 0, std::move(text_encoder)));
    if (const auto loaded = policy->LoadStateTensors(checkpoint.tensors); !loaded)
      return Fail(Code::kCorrupt, "checkpoint: " + loaded.error().message);
    policy->eval();
    return policy;
  } catch (const c10::Error& error) {
    return Fail(policy::TorchError("checkpoint", error, Code::kCorrupt));
  }
}

}  // namespace etude::checkpoint
