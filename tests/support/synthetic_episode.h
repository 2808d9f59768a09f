// SPDX-License-Identifier: Apache-2.0
// Small episodes without a simulator, for tests of everything that stores, sends or learns from
// them.
#pragma once

#include <array>
#include <cstdint>
#include <string>

#include "services/episode/episode.h"
#include "services/spec/campaign_spec.h"

namespace etude {

/// A valid spec whose episodes are small: 32x32 px, stride 5, all tasks and objects.
CampaignSpec SyntheticSpec(int width = 32, int height = 32);

/// A deterministic, valid episode: pure in (spec, index, steps).
///
/// The hand moves from a drawn start to the target object and lifts it; joint positions are a
/// smooth one-to-one function of the hand's position, so that a policy can learn one from the
/// other. All objects of the spec lie in view at drawn places. Each picture shows a bright disc of
/// the object's own colour (SyntheticColor) around its exact projection, and a white one just above
/// the hand.
Episode MakeSyntheticEpisode(const CampaignSpec& spec, std::uint64_t index, int steps = 50);

/// The same frames in streams of another shape.
Episode Recut(Episode episode, codec::ChunkShape chunk);

/// RGB of an object's disc.
std::array<std::uint8_t, 3> SyntheticColor(const std::string& object);

}  // namespace etude
