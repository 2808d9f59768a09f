// SPDX-License-Identifier: Apache-2.0
// The small language in which a module says what it reads, attends to and decodes. No torch here.
#pragma once

#include <string>
#include <vector>

#include "trainer/data/labels.h"
#include "trainer/policy/config.h"
#include "trainer/policy/quantities/quantity.h"

namespace etude::policy {

/// One entry of DecoderConfig::inputs, "[fourier:]KIND[:MODULE]".
struct DecoderInput {
  bool fourier = false;
  std::string kind;
  std::string module;  ///< "": the module itself, or a token
};
DecoderInput ParseDecoderInput(const std::string& text);

/// image, language, joints, self, all: no module may be called so.
bool IsReservedName(const std::string& name);

/// nullptr: none is called so. A pointer into `config`.
const ModuleConfig* FindModule(const PolicyConfig& config, const std::string& name);

/// By level, then as listed. Pointers into `config`.
std::vector<const ModuleConfig*> EvaluationOrder(const PolicyConfig& config);

/// ModuleConfig::reads with "all" written out.
std::vector<std::string> ResolveReads(const PolicyConfig& config, const ModuleConfig& module);

/// The quantity that it decodes; nullptr: none.
const Quantity* QuantityOf(const ModuleConfig& module);
/// The names that a categorical quantity tells apart: tasks or objects.
const std::vector<std::string>& ClassesOf(const PolicyConfig& config, const std::string& quantity);
/// The form of its last layer.
Head HeadOf(const PolicyConfig& config, const ModuleConfig& module);

/// Whether `module`'s decoder yields a `quantity` (a pose yields a position too).
bool Decodes(const ModuleConfig& module, const std::string& quantity);

/// Whether any module reads where the camera is, so that Inputs::viewpoint matters.
bool ReadsCamera(const PolicyConfig& config);

/// Whether any module decodes the command's task, so that PolicyConfig::tasks matters.
bool DecodesTask(const PolicyConfig& config);

/// Numbers of one entry of DecoderConfig::inputs. @param joints  of an observation
int FeatureWidth(const PolicyConfig& config, const DecoderInput& input, int joints);

/// "target" of "image@target"; "" of anything else.
std::string AttendedEntity(const std::string& attend);
/// Whether a module learns where in the picture to look, whatever it decodes.
bool IsToldWhereToLook(const ModuleConfig& module);
/// Whether training asks anything of it itself.
bool HasLoss(const ModuleConfig& module);

/// The labels that the modules are trained on, each once. Rules live as long as the program.
std::vector<data::LabelColumn> LabelColumnsOf(const PolicyConfig& config);

/// The module whose waypoints a robot drives: the last one evaluated that decodes a trajectory; nullptr: none does.
const ModuleConfig* DrivingModule(const PolicyConfig& config);

}  // namespace etude::policy
