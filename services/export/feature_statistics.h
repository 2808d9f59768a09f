// SPDX-License-Identifier: Apache-2.0
// What LeRobot keeps of each feature: minimum, maximum, mean, standard deviation, count and five quantiles, of an
// episode and of many.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "services/core/config.h"

namespace etude::exports {

/// In percent, as LeRobot 3.0 names them: q01, q10, q50, q90, q99.
inline constexpr std::array<int, 5> kQuantiles{1, 10, 50, 90, 99};

/// Of one feature; every vector has a number a dimension of the feature (of pictures: a channel).
struct FeatureStatistics {
  std::vector<double> min, max, mean, std;
  std::array<std::vector<double>, kQuantiles.size()> quantiles;
  std::int64_t count = 0;  ///< rows; of pictures: pictures

  std::size_t dimensions() const { return min.size(); }
};

/// Of rows of `columns` numbers. Numbers that are not finite (pixels behind a camera) are left out; where none is left
/// all statistics are 0. Quantiles are interpolated between neighbours.
FeatureStatistics StatisticsOf(std::span<const double> values, std::size_t columns);

/// Counts the bytes of RGB pictures; statistics are of byte / 255.
class PictureStatistics {
 public:
  void Add(std::span<const std::uint8_t> rgb);
  FeatureStatistics Finish() const;

 private:
  std::array<std::array<std::uint64_t, 256>, 3> counts_{};
  std::int64_t pictures_ = 0;
};

/// Those of all rows of both, as LeRobot aggregates them: quantiles, which cannot be had from quantiles, become bounds
/// (the smaller of the lower ones, the larger of the upper ones). The first of two may be empty.
FeatureStatistics Merge(const FeatureStatistics& a, const FeatureStatistics& b);

enum class WithQuantiles : std::uint8_t { kNo, kYes };

/// {"min": [...], "max": ..., "mean", "std", "count": [n], "q01", ...}; of pictures each number stands in two more
/// lists:
/// [[[r]], [[g]], [[b]]].
OrderedJson ToJson(const FeatureStatistics& statistics, bool is_picture, WithQuantiles quantiles);

}  // namespace etude::exports
