// SPDX-License-Identifier: Apache-2.0
// The small language in which a module says what it reads, attends to and decodes. No torch here.
#pragma once

#include <string>
#include <vector>

#include "trainer/policy/config.h"

namespace etude::policy {

/// One entry of DecoderConfig::inputs, "[waves:]KIND[:MODULE]".
struct DecoderInput {
  bool waves = false;
  std::string kind;
  std::string module;  ///< "": the module itself, or a token
};
DecoderInput ParseDecoderInput(const std::string& text);

/// image, language, joints, self, all: no module may be called so.
bool IsReservedName(const std::string& name);

/// By level, then as listed. Pointers into `config`.
std::vector<const ModuleConfig*> EvaluationOrder(const PolicyConfig& config);

/// ModuleConfig::reads with "all" written out.
std::vector<std::string> ResolveReads(const PolicyConfig& config, const ModuleConfig& module);

/// "target_pixel" -> "pixel": class, pixel, position, pose, displacement or trajectory; "" of "".
std::string DecodeKind(const std::string& label);

/// Whether `module`'s decoder yields a `kind` (a pose yields a position too).
bool Decodes(const ModuleConfig& module, const std::string& kind);

}  // namespace etude::policy
