// SPDX-License-Identifier: Apache-2.0
// Small statistics that reports share.
#pragma once

#include <cstdint>
#include <vector>

namespace etude {

struct Interval {
  double low = 0;
  double high = 1;
};

/// Wilson score interval of a proportion, 95 %. (0, 1) when trials = 0.
/// Source: Wilson (1927), "Probable inference, the law of succession, and statistical inference".
Interval WilsonInterval(std::uint64_t successes, std::uint64_t trials);

/// Linear-interpolated quantile of unsorted values, q in [0, 1]; NaN when empty.
double Quantile(std::vector<double> values, double q);
double Mean(const std::vector<double>& values);

}  // namespace etude
