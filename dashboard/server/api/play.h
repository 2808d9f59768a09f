// SPDX-License-Identifier: Apache-2.0
// Campaigns that come with the programs, and pictures of their scenes.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "services/core/file.h"
#include "services/core/result.h"

namespace etude::api {

/// Their names.
std::vector<std::string> ShippedCampaigns();
/// The file of one of them. @error kNotFound: names them
Result<Path> ShippedCampaign(const std::string& name);

/// The first picture of an episode.
struct ScenePicture {
  Path spec;  ///< campaign file
  std::uint64_t index = 0;
  std::optional<std::uint64_t> seed = {};  ///< instead of the spec's
};
/// Has `worker`, an etude-worker, draw it into `file`, a PNG.
/// @error kInvalidArgument, kUnavailable, kInternal: as it ended (CodeForExit), in its words; kTimeout
Status RenderScene(const Path& worker, const ScenePicture& picture, const Path& file);

}  // namespace etude::api
