// SPDX-License-Identifier: Apache-2.0
// Draws pictures with depth of ten classes of household objects: ours, so that objects can be made without any network
// or photograph.
#pragma once

#include <string>
#include <vector>

#include "services/core/result.h"
#include "worker/synthesis/picture.h"

namespace etude::synthesis {

/// What is known of a class besides its looks.
struct ClassFacts {
  std::string name;
  double smallest_m;  ///< largest extent of the smallest instance, before kWidestGrasp
  double largest_m;   ///< and of the largest
  double density;     ///< kg/m^3, mean over the body
};

/// m that an object may measure across: what the fingers of a hand close around.
inline constexpr double kWidestGrasp = 0.068;

/// apple, avocado, donut, hamburger, lemon, mug, orange, pear, sourdough, strawberry
const std::vector<ClassFacts>& KnownClasses();

/// @error kInvalidArgument: unknown class; the message has the nearest known one
Result<ClassFacts> FindClass(const std::string& name);

/// A picture of one instance from the front, as it stands, `kPictureSize` px square, without shading, on white; the
/// same for the same seed.
/// Other seeds give other shapes, proportions, colours and details.
/// @error kInvalidArgument: unknown class
/// Thread safety: concurrent calls.
inline constexpr int kPictureSize = 256;
Result<Picture> Draw(const std::string& class_name, std::uint64_t seed);

}  // namespace etude::synthesis
