// SPDX-License-Identifier: Apache-2.0
#include "trainer/policy/crop.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "services/core/check.h"

namespace etude::policy {
namespace {

constexpr double kMargin = 6;  // px around the work volume
constexpr int kMultiple = 8;   // px, of the sides
constexpr int kLeast = 8;      // px, of the sides

int Stride(const ImageConfig& image) {
  int stride = 1;
  for (const ImageLayer& layer : image.layers)
    if (layer.kind == "conv") stride *= layer.stride;
  return stride;
}

// first pixel and length that hold [low, high] of `size` px
std::pair<int, int> Side(double low, double high, int size, int multiple) {
  const double wanted = std::ceil((high - low) / multiple) * multiple;
  const int length = static_cast<int>(std::min<double>(wanted, size / multiple * multiple));
  const double first = std::round((low + high - length) / 2);
  return {static_cast<int>(std::clamp<double>(first, 0, size - length)), length};
}

/// A rectangle of the picture, px: u, v.
struct Bounds {
  double low[2] = {std::numeric_limits<double>::infinity(), std::numeric_limits<double>::infinity()};
  double high[2] = {-low[0], -low[1]};
};

// Extends `bounds` so that they hold the work volume as the camera sees it, and the margin.
Status Extend(const std::vector<double>& box, const Camera& camera, Bounds& bounds) {
  for (int corner = 0; corner < 8; ++corner) {
    const auto at = [&](int axis) { return box[static_cast<std::size_t>(2 * axis + ((corner >> axis) & 1))]; };
    const Eigen::Vector2d pixel = camera.Project({at(0), at(1), at(2)});
    if (!pixel.allFinite())
      return Fail(Code::kInvalidArgument,
                  "image.crop: a corner of image.work_volume lies behind the camera; give "
                  "image.crop as numbers");
    for (int i = 0; i < 2; ++i) {
      bounds.low[i] = std::min(bounds.low[i], pixel[i] - kMargin);
      bounds.high[i] = std::max(bounds.high[i], pixel[i] + kMargin);
    }
  }
  return {};
}

Result<codec::Region> Derive(const ImageConfig& image, std::span<const Camera> cameras) {
  const Camera& camera = cameras.front();
  Bounds bounds;
  for (const Camera& one : cameras) ETUDE_RETURN_IF_ERROR(Extend(image.work_volume, one, bounds));
  const auto& [low, high] = bounds;
  const int multiple = std::max(kMultiple, Stride(image));
  // what the picture does not have cannot be seen: cut before the sides are rounded
  const auto side = [&](int axis, int size) {
    return Side(std::max(0.0, low[axis]), std::min<double>(size, high[axis]), size, multiple);
  };
  if (high[0] <= 0 || high[1] <= 0 || low[0] >= camera.width || low[1] >= camera.height)
    return Fail(Code::kInvalidArgument, "image.crop: the camera does not see image.work_volume");
  const auto [u, width] = side(0, camera.width);
  const auto [v, height] = side(1, camera.height);
  return codec::Region{u, v, width, height};
}

}  // namespace

Result<codec::Region> ResolveCrop(const ImageConfig& image, const Camera& camera) {
  return ResolveCrop(image, std::span(&camera, 1));
}

Result<codec::Region> ResolveCrop(const ImageConfig& image, std::span<const Camera> cameras) {
  ETUDE_CHECK(!cameras.empty());
  const Camera& camera = cameras.front();
  codec::Region region;
  if (image.crop.empty()) {
    ETUDE_ASSIGN_OR_RETURN(region, Derive(image, cameras));
  } else {
    region = CropOf(image);
  }
  if (!codec::Fits(region, camera.width, camera.height) || region.width < kLeast || region.height < kLeast)
    return Fail(Code::kInvalidArgument,
                fmt::format("policy.image.crop: {}x{} px at ({}, {}) does not fit the dataset's pictures of {}x{} px",
                            region.width, region.height, region.u, region.v, camera.width, camera.height));
  return region;
}

codec::Region CropOf(const ImageConfig& image) {
  ETUDE_CHECK(image.crop.size() == 4, "{} numbers", image.crop.size());
  return {image.crop[0], image.crop[1], image.crop[2], image.crop[3]};
}

std::vector<int> ToNumbers(const codec::Region& region) { return {region.u, region.v, region.width, region.height}; }

}  // namespace etude::policy
