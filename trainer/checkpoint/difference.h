// SPDX-License-Identifier: Apache-2.0
// What changed from one checkpoint to another.
#pragma once

#include <string>
#include <vector>

#include "trainer/checkpoint/checkpoint.h"

namespace etude::checkpoint {

/// One part (trainer/policy/parts.h) in both.
struct PartDifference {
  enum class State { kSame, kChanged, kReshaped, kOnlyInFirst, kOnlyInSecond };
  std::string part;
  State state = State::kSame;
  double relative = 0;               ///< kChanged: |b - a| / |a|, over what both have
  std::int64_t numbers = 0;          ///< of the part, in the second where it has it
  std::vector<std::string> tensors;  ///< kReshaped: by name, with both shapes
};

/// Every part of either, those of the first in its order. kSame is bit for bit; statistics of the data are the part
/// "normalization".
std::vector<PartDifference> Compare(const Checkpoint& first, const Checkpoint& second);

/// A table for people.
std::string ToText(const std::vector<PartDifference>& differences);

}  // namespace etude::checkpoint
