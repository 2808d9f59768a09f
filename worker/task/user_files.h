// SPDX-License-Identifier: Apache-2.0
// The files of the user that a campaign names by their paths: robots, imported objects and tasks.
#pragma once

#include <string>

#include "services/core/result.h"
#include "services/spec/campaign_spec.h"

namespace etude::task {

/// SHA-256 over what stands in them now, with all that they refer to (MJCF, meshes, textures); "" when `spec` names
/// none. Equal on two hosts that make the same episodes.
/// @error of the files: kNotFound, kInvalidArgument.  Cost: builds a scene for each robot file.
Result<std::string> UserFilesSha256(const CampaignSpec& spec);

}  // namespace etude::task
