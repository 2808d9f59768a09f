// SPDX-License-Identifier: Apache-2.0
// Depth of a colour picture by a user's ONNX network. OpenCV stays behind this header.
#pragma once

#include <memory>

#include "services/core/file.h"
#include "services/core/result.h"
#include "worker/synthesis/picture.h"

namespace etude::synthesis {

struct DepthNetworkOptions {
  int width = 256;  ///< px of the network's input
  int height = 256;
  double relief = 0.35;      ///< height of the nearest point over the outline, in widths of the picture
  double background = 0.10;  ///< how far (0..1) a colour may be from that of the border to count as background
};

/// A network from RGB (1, 3, height, width), with the mean and spread of ImageNet taken off, to inverse depth, larger
/// is nearer, (1, height, width) or (1, 1, height, width). Reference: MiDaS v2.1 small, whose input is 256 x 256. One
/// per thread.
class DepthNetwork {
 public:
  /// @error kNotFound: no such file; kCorrupt: not a network that OpenCV can read (its message).
  static Result<DepthNetwork> Open(const Path& onnx, const DepthNetworkOptions& options = {});
  DepthNetwork(DepthNetwork&&) noexcept;
  ~DepthNetwork();

  /// A picture with the network's depth, stretched over the object from its fifth percentile up. The object is what
  /// differs from the colour of the picture's border.
  /// @error kNotFound, kCorrupt: not a picture; kInvalidArgument: no object on a plain background, or an output of
  /// another shape.
  Result<Picture> Read(const Path& rgb);

 private:
  struct Impl;
  explicit DepthNetwork(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace etude::synthesis
