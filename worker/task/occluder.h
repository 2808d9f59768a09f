// SPDX-License-Identifier: Apache-2.0
// Covers a share of the target in the pictures that a policy gets: the paper's test of occlusion (Fig. 10). It says how
// much of the target's segmented area is removed, not how; the mechanism here is ours.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "services/core/config.h"
#include "worker/sim/renderer.h"

namespace etude::task {

inline constexpr int kOcclusionBlock = 8;            ///< px: a token of the paper's policy
inline constexpr std::uint8_t kOcclusionGrey = 128;  ///< of all three channels

/// The order in which the blocks of a picture are covered: the numbers of all its blocks, row by row from the top left,
/// shuffled. Blocks at the right and lower edge may be smaller.
std::vector<int> OcclusionOrder(int width, int height, std::uint64_t seed);

/// Lays grey blocks over `rgb` (height * width * 3, top row first), in `order`, each over a block of the picture's grid
/// that shows some of the target, until `share` (0..1) of the target's pixels is covered. The last block is cut: it
/// ends, row by row, with the pixel that makes the share up, so that few pixels are covered no more coarsely than many.
/// @param target  height * width, not 0 where the picture shows the target
/// @returns how many of the target's pixels are covered: the smallest number that is no less than the share
int CoverBlocks(std::span<const std::uint8_t> target, int width, int height, double share, std::span<const int> order,
                std::span<std::uint8_t> rgb);

/// Of one rollout. The blocks lie on the picture's grid in an order that is fixed for the rollout; which of them are
/// covered follows the target from picture to picture. Not thread-safe.
class Occluder {
 public:
  /// `world` and `renderer` are borrowed. @param share  0..1, of the pixels that show the target
  Occluder(const sim::World* world, sim::Renderer* renderer, const std::string& target, double share,
           std::uint64_t seed);

  /// @param rgb  a picture of the world as it is now. Cost: a segmentation rendering.
  void Cover(std::span<std::uint8_t> rgb);
  /// {"share", "covered", "pictures"}: what was asked for; the mean of what was covered over the pictures that showed
  /// the target, and how many did. "covered" is left out when none did.
  OrderedJson Report() const;

 private:
  const sim::World* world_;
  sim::Renderer* renderer_;
  std::int32_t body_;
  double share_;
  std::vector<int> order_;
  std::vector<std::int32_t> bodies_;
  std::vector<std::uint8_t> mask_;
  double covered_ = 0;  // sum of shares
  int pictures_ = 0;
};

}  // namespace etude::task
