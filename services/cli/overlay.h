// SPDX-License-Identifier: Apache-2.0
// Draws over a picture what a policy saw in it and said of it. OpenCV stays behind this header.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "services/episode/camera.h"
#include "services/policy/insight.h"

namespace etude::cli {

using Color = std::array<std::uint8_t, 3>;  ///< RGB

/// Of planned waypoints, and of what has no hue of its own.
inline constexpr Color kWhite{255, 255, 255};

struct ColoredWord {
  std::string text;
  Color color = kWhite;
};

/// The modules that DrawOverlay shows in the picture, each in its color, in the order in which they are said. A color
/// is of what a module speaks of (the hand, the target, ...): the same in every picture of a policy.
std::vector<ColoredWord> Legend(const policy::Insight& insight);

/// The part of the straight way from `a_W` to `b_W` (m, world) that `camera` sees, as its two ends in px of the
/// camera's picture, within [0, width] x [0, height]; nothing when it sees none of it, or a number is not finite.
std::optional<std::array<Eigen::Vector2d, 2>> VisiblePart(const Camera& camera, const Eigen::Vector3d& a_W,
                                                          const Eigen::Vector3d& b_W);

/// A function of its arguments alone. From below to above:
///   - a thin frame around what the policy sees, where that is not the whole picture;
///   - patches, tinted by weight, of each module that has half of its attention or more on the picture;
///   - each displacement as an arrow from where the policy says that the hand is, with its length;
///   - planned waypoints as a line with dots;
///   - decoded pixels as a cross with the module's name;
///   - classes and tasks as words in the corner at the top left.
/// What is not said or not finite, behind the camera or outside the picture is left out.
/// @param camera  that took the picture
/// @param rgb  its picture enlarged `scale` times, (height * scale, width * scale, 3), top row first; is drawn on
void DrawOverlay(const policy::Insight& insight, const Camera& camera, int scale, std::span<std::uint8_t> rgb);

}  // namespace etude::cli
