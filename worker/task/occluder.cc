// SPDX-License-Identifier: Apache-2.0
#include "worker/task/occluder.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "services/core/check.h"
#include "services/core/rng.h"

namespace etude::task {
namespace {

int BlocksAlong(int pixels) { return (pixels + kOcclusionBlock - 1) / kOcclusionBlock; }

// The part of the picture under one block.
struct Block {
  int left, top, right, bottom;  // px, the latter two beyond it
};

Block BlockAt(int number, int width, int height) {
  const int column = number % BlocksAlong(width), row = number / BlocksAlong(width);
  return {column * kOcclusionBlock, row * kOcclusionBlock, std::min((column + 1) * kOcclusionBlock, width),
          std::min((row + 1) * kOcclusionBlock, height)};
}

// Greys the block until `wanted` pixels of the target are covered; returns how many are.
int Cover(const Block& block, std::span<const std::uint8_t> target, int width, int wanted,
          std::span<std::uint8_t> rgb) {
  int covered = 0;
  for (int y = block.top; y < block.bottom; ++y)
    for (int x = block.left; x < block.right && covered < wanted; ++x) {
      const std::size_t pixel = static_cast<std::size_t>(y) * width + x;
      covered += target[pixel] != 0;
      std::fill_n(rgb.begin() + static_cast<std::ptrdiff_t>(3 * pixel), 3, kOcclusionGrey);
    }
  return covered;
}

bool Shows(const Block& block, std::span<const std::uint8_t> target, int width) {
  for (int y = block.top; y < block.bottom; ++y)
    for (int x = block.left; x < block.right; ++x)
      if (target[static_cast<std::size_t>(y) * width + x] != 0) return true;
  return false;
}

}  // namespace

std::vector<int> OcclusionOrder(int width, int height, std::uint64_t seed) {
  std::vector<int> order(static_cast<std::size_t>(BlocksAlong(width)) * BlocksAlong(height));
  std::iota(order.begin(), order.end(), 0);
  Rng rng(seed);
  rng.Shuffle(order);
  return order;
}

int CoverBlocks(std::span<const std::uint8_t> target, int width, int height, double share, std::span<const int> order,
                std::span<std::uint8_t> rgb) {
  const auto shown = static_cast<double>(target.size() - std::ranges::count(target, std::uint8_t{0}));
  const int wanted = static_cast<int>(std::ceil(share * shown - 1e-9));
  int covered = 0;
  for (auto number = order.begin(); covered < wanted && number != order.end(); ++number) {
    const Block block = BlockAt(*number, width, height);
    if (Shows(block, target, width)) covered += Cover(block, target, width, wanted - covered, rgb);
  }
  return covered;
}

Occluder::Occluder(const sim::World* world, sim::Renderer* renderer, const std::string& target, double share,
                   std::uint64_t seed)
    : world_(world), renderer_(renderer), body_(world->BodyId(target)), share_(share) {
  const Camera& camera = world->scene().camera();
  order_ = OcclusionOrder(camera.width, camera.height, seed);
  bodies_.resize(static_cast<std::size_t>(camera.width) * camera.height);
  mask_.resize(bodies_.size());
}

void Occluder::Cover(std::span<std::uint8_t> rgb) {
  ETUDE_CHECK(rgb.size() == 3 * mask_.size(), "{} bytes", rgb.size());
  renderer_->RenderSegmentation(*world_, bodies_);
  std::ranges::transform(bodies_, mask_.begin(), [this](std::int32_t body) { return body == body_ ? 1 : 0; });
  const auto shown = std::ranges::count(mask_, 1);
  if (shown == 0) return;
  const Camera& camera = world_->scene().camera();
  const int covered = CoverBlocks(mask_, camera.width, camera.height, share_, order_, rgb);
  covered_ += static_cast<double>(covered) / static_cast<double>(shown);
  ++pictures_;
}

OrderedJson Occluder::Report() const {
  OrderedJson json{{"share", share_}};
  if (pictures_ > 0) json["covered"] = covered_ / pictures_;
  json["pictures"] = pictures_;
  return json;
}

}  // namespace etude::task
