// SPDX-License-Identifier: Apache-2.0
// Which part of the camera's picture a policy sees. No torch here.
#pragma once

#include <span>
#include <vector>

#include "services/codec/crop.h"
#include "services/core/result.h"
#include "services/episode/camera.h"
#include "trainer/policy/config.h"

namespace etude::policy {

/// image.crop as it stands, or derived: the work volume's projection with 6 px around it, sides rounded up to a
/// multiple of 8 (or of the image tokens' stride, where that is more), moved and cut to what the picture has.
/// @error kInvalidArgument: the crop does not fit the camera's picture; the camera does not see the work volume.
Result<codec::Region> ResolveCrop(const ImageConfig& image, const Camera& camera);
/// The same for a camera that moves: what is derived holds the work volume as each of `cameras` sees it.
/// @pre at least one; their pictures are of one size
Result<codec::Region> ResolveCrop(const ImageConfig& image, std::span<const Camera> cameras);

/// image.crop, resolved. @pre four numbers
codec::Region CropOf(const ImageConfig& image);
/// The numbers of image.crop.
std::vector<int> ToNumbers(const codec::Region& region);

}  // namespace etude::policy
