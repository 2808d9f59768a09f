// SPDX-License-Identifier: Apache-2.0
// What the figures of a run are called, in which unit, and which goals they are held against.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "dashboard/server/sources/run_source.h"
#include "services/core/config.h"

namespace etude::api {

/// Of each series [{key, kind, name, module, unit, n, nulls, last}]: "valid/TAR3D.cm" is figure cm of module TAR3D in
/// lines of kind valid.
OrderedJson KeysJson(const sources::MetricsTable& metrics);
/// Figures that were no number: how many, and the first of them as [{step, key}].
std::uint64_t CountOfNulls(const sources::MetricsTable& metrics);
OrderedJson NullsJson(const sources::MetricsTable& metrics);

/// Names of the policy's modules, as the config has them.
std::vector<std::string> Modules(const OrderedJson& config);
/// What a module decodes; "": the config has no such module.
std::string QuantityOf(const OrderedJson& config, const std::string& module);
/// [{module, goal, value, unit, reached, key}]: the curriculum's goals in the unit that is shown, and the last figure
/// of validation that each is held against.
OrderedJson GoalsJson(const sources::RunView& view);

}  // namespace etude::api
