// SPDX-License-Identifier: Apache-2.0
// Commands that make datasets of datasets, and take them to and from other formats.
#pragma once

#include "services/cli/command_line.h"

namespace etude::cli {

/// Adds filter, split, merge, link, delete, export and import to `etude dataset`.
void AddDatasetEdit(CLI::App& command, Body& body);

}  // namespace etude::cli
