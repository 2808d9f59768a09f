// SPDX-License-Identifier: Apache-2.0
// A policy's parts: what can be copied from another checkpoint, begun anew or frozen, by name. No torch here.
//   image, language, joints   the encoders
//   TAR2D, CTRL, ...          the modules
//   attention2                with shared attention: what the modules of level 2 share
#pragma once

#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "trainer/policy/config.h"

namespace etude::policy {

/// Whether `part` is image, language or joints.
bool IsEncoder(std::string_view part);

/// Encoders first, then modules in the order of evaluation, each followed by its level's attention where that is
/// shared and was not named yet.
std::vector<std::string> PartsOf(const PolicyConfig& config);

/// "attention2", which a module of level 2 shares with its level; "" where attention is a module's own.
std::string AttentionPartOf(const PolicyConfig& config, const ModuleConfig& module);

/// The part that a parameter or buffer belongs to, e.g. "joints" of "joints_norm.weight" and "TAR2D" of
/// "modules.TAR2D.segments.language"; "" of statistics of the data, which belong to none.
std::string PartOfTensor(std::string_view tensor);

/// Whether `tensor` is there because its module reads one thing more (a decoder's columns, a key's segment): a
/// module's copy may have it while the original does not.
bool IsOfOneInput(std::string_view tensor);

/// Parts that compute from what `module` reads directly: encoders and other modules, itself left out.
std::vector<std::string> ReadParts(const PolicyConfig& config, const ModuleConfig& module);

/// What `part` computes with of the data's statistics (Normalization): joint, position, displacement, offset. Those of
/// joints are of their encoder alone.
std::set<std::string> StatisticsOf(const PolicyConfig& config, const std::string& part);

/// @error kInvalidArgument: a name that is no part of `config`, with the nearest one. @param what  e.g. "init.freeze"
Status CheckParts(const PolicyConfig& config, const std::string& what, const std::vector<std::string>& names);

}  // namespace etude::policy
