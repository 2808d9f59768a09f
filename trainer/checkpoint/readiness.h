// SPDX-License-Identifier: Apache-2.0
// Nothing untrained at the controls: which modules an answer depends on, and whether each was trained and measured.
#pragma once

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

}  // namespace etude::checkpoint
