// SPDX-License-Identifier: Apache-2.0
// `attempt replay`: any attempt of a campaign again, failed ones too, with all that is known of it.
#pragma once

#include <cstdint>

#include "services/core/file.h"
#include "services/core/result.h"
#include "services/spec/campaign_spec.h"
#include "worker/sim/renderer.h"

namespace etude {

struct ReplayOptions {
  std::uint64_t index = 0;
  std::uint32_t attempt = 0;
  Path out;  ///< a folder that is not there yet, or empty
};

/// Makes the attempt and writes
///   OUT/episodes/..., dataset.json, dataset.hdf5   a dataset of this one episode
///   OUT/plan.json       what it is about, how it ended and why, the scene's draws, the motions planned, the distances
///   OUT/geometry.json   bodies and their collision pieces, and the layout of
///   OUT/poses.f32       where every body was at every control step
/// and prints a line. An attempt that ended before anything moved has plan.json and geometry.json only.
/// @error kInvalidArgument: OUT is not empty, or the campaign's mode has no expert; of the scene and of the disk
Status ReplayAttempt(const CampaignSpec& spec, const ReplayOptions& options, const sim::RendererConfig& renderer);

}  // namespace etude
