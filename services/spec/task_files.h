// SPDX-License-Identifier: Apache-2.0
// Task files of the user's, whose content is part of a spec's hash.
#pragma once

#include <string>
#include <vector>

#include "services/spec/campaign_spec.h"

namespace etude {

/// Paths of the task files that `spec` names, without "+obstacle" and the like, each once.
std::vector<std::string> TaskFilesOf(const CampaignSpec& spec);

/// Why the hash of a spec is not the one that was noted with it: its task files, which may be others here, by name;
/// without any, that another version knows other keys.
std::string WhyHashDiffers(const CampaignSpec& spec);

}  // namespace etude
