// SPDX-License-Identifier: Apache-2.0
// A checkpoint as a TorchScript file that opens with plain libtorch (torch::jit::load), without anything of ours.
//
//   forward(crop, joints, token_ids[, viewpoint]) -> waypoints
//     crop       (1, 3, h, w) uint8: the part of the picture that the policy looks at, RGB
//     joints     (1, J) float32: arm joints (rad), then gripper joints
//     token_ids  (W, F) int64: words by features, as services/language/tokenizer.h has them; -1 fills
//     viewpoint  (1, 12) float32 of a policy that reads its camera (readout `ray`) alone: services/episode/viewpoint.h
//     waypoints  (12, 10) float32 as in services/episode/action.h: x, y, z (m), rotation in 6D, gripper
//
// The file "etude.json" inside it says which part of the picture, which joints, which step of which run. It is made by
// tracing one evaluation, in float32 and with torch's own operations; a batch is always one, the number of words and
// features is free.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "services/language/senses.h"
#include "trainer/checkpoint/checkpoint.h"

namespace etude::checkpoint {

/// Name of the file inside that says what it is, a map in JSON.
inline constexpr const char* kTorchScriptFacts = "etude.json";

/// The bytes. What they say was compared with the policy itself, on pictures and joints drawn at random and sentences
/// of several lengths: the waypoints are the same to 1e-5.
/// @error kInvalidArgument: no module decodes a trajectory, modules on its way are untrained, language is clip:DIR (its
/// text encoder is not in the checkpoint); kCorrupt as BuildPolicy; kInternal: of torch, or it says something else
Result<std::string> ToTorchScript(const Checkpoint& checkpoint);

/// What forward takes, in order: crop, joints, token_ids, and viewpoint where the policy reads its camera.
std::vector<std::string> InputNames(const policy::PolicyConfig& policy);

/// (W, F) int64 of a sentence, for token_ids.
/// @param buckets  of the policy's language
/// @param senses   of a policy whose language has them (token_senses in the facts), else nullptr
torch::Tensor TokenIds(const std::string& sentence, int buckets, const language::Senses* senses = nullptr);

}  // namespace etude::checkpoint
