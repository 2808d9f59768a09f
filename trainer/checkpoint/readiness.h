// SPDX-License-Identifier: Apache-2.0
// Nothing untrained at the controls: which modules an answer depends on, whether each was trained and measured, and
// which have not begun to learn.
#pragma once

#include <map>
#include <set>
#include <string>
#include <vector>

#include "services/core/result.h"
#include "trainer/checkpoint/metadata.h"

namespace etude::checkpoint {

/// Modules that the trajectory depends on, itself included, in the order of evaluation; empty when the policy
/// decodes none.
std::vector<std::string> ControlPath(const policy::PolicyConfig& config);

/// Why the policy may not drive a robot: "CTRL has 0 trained steps; DISP has no validation error"; "" when it may.
/// A module that decodes nothing cannot be measured and only needs to be trained.
std::string WhyUntrained(const Metadata& metadata);

/// @error kUnavailable with WhyUntrained, run and step.
Status CheckTrained(const Metadata& metadata);

/// Of the modules of `config` that have a loss of their own, of which alone steps are counted, those that were
/// neither trained nor measured; only what is in training is measured. None where `records` count no steps at all, as
/// those of before do.
std::set<std::string> NotBegun(const policy::PolicyConfig& config, const std::map<std::string, ModuleRecord>& records);

}  // namespace etude::checkpoint
