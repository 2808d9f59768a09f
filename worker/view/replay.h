// SPDX-License-Identifier: Apache-2.0
// `attempt replay`: any attempt of a campaign again, failed ones too, with all that is known of it.
#pragma once

#include <cstdint>
#include <optional>

#include "services/core/file.h"
#include "services/core/result.h"
#include "services/spec/campaign_spec.h"
#include "services/spec/sampling_weights.h"
#include "worker/sim/renderer.h"

namespace etude {

struct ReplayOptions {
  std::uint64_t index = 0;
  std::uint32_t attempt = 0;
  Path out;                               ///< a folder that is not there yet, or empty
  std::optional<SamplingEntry> sampling;  ///< of the dataset's journal, that holds for `index`; none of a file
};

/// Makes the attempt and writes
///   OUT/episodes/..., dataset.json, dataset.hdf5   a dataset of this one episode
///   OUT/plan.json       what it is about, how it ended and why, the scene's draws, the motions planned, the nearest
///                       pairs with their distances and points
///   OUT/geometry.json   bodies and their collision pieces, and the layout of
///   OUT/poses.f32       where every body was at every control step
/// and prints a line. An attempt that ended before anything moved has plan.json and geometry.json only.
/// @error kInvalidArgument: OUT is not empty, the campaign's mode has no expert, or the weights are not of the spec; of
/// the scene and of the disk
Status ReplayAttempt(const CampaignSpec& spec, const ReplayOptions& options, const sim::RendererConfig& renderer);

}  // namespace etude
