// SPDX-License-Identifier: Apache-2.0
// A checkpoint and its bytes: a safetensors file with metadata.h as its metadata and Policy::StateTensors,
// normalisation included, as its tensors.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "services/core/file.h"
#include "trainer/checkpoint/metadata.h"
#include "trainer/policy/clip/text_encoder.h"
#include "trainer/policy/policy.h"
#include "trainer/policy/torch.h"

namespace etude::checkpoint {

struct Checkpoint {
  Metadata metadata;
  std::map<std::string, torch::Tensor> tensors;
};

/// The bytes of a checkpoint file of today's schema; a pure function of the checkpoint.
/// @error kInvalidArgument: a tensor of a type that cannot be saved.
Result<std::vector<std::uint8_t>> Encode(const Checkpoint& checkpoint);

/// Of this schema or an older one, whatever version of the program wrote it. Nothing is allocated from a size
/// that the bytes claim and do not hold.
/// @error kCorrupt: not safetensors, not a checkpoint, metadata that does not parse, an architecture hash that is not
/// the configuration's, sizes that the file does not hold; kInvalidArgument: a newer schema. The message says which.
Result<Checkpoint> Decode(std::span<const std::uint8_t> bytes);
Result<Checkpoint> ReadFile(const Path& path);

/// The network with these weights, in evaluation mode.
/// @param folders  where clip's folder of a policy whose language is clip:DIR is looked for; none: where it says
/// @error kCorrupt: tensors that do not fit the architecture; as clip::TextEncoder::Open
Result<std::shared_ptr<policy::Policy>> BuildPolicy(const Checkpoint& checkpoint, clip::Folders* folders = nullptr);

}  // namespace etude::checkpoint
