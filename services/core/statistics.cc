// SPDX-License-Identifier: Apache-2.0
#include "services/core/statistics.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

namespace etude {

Interval WilsonInterval(std::uint64_t successes, std::uint64_t trials) {
  if (trials == 0) return {};
  constexpr double z = 1.959963984540054;  // 97.5 % quantile of the normal distribution
  const double n = static_cast<double>(trials);
  const double p = static_cast<double>(successes) / n;
  const double centre = (p + z * z / (2 * n)) / (1 + z * z / n);
  const double half = z / (1 + z * z / n) * std::sqrt(p * (1 - p) / n + z * z / (4 * n * n));
  return {std::max(0.0, centre - half), std::min(1.0, centre + half)};
}

double McNemarExactP(std::uint64_t only_first, std::uint64_t only_second) {
  const std::uint64_t n = only_first + only_second, fewer = std::min(only_first, only_second);
  if (only_first == only_second) return 1;
  // sum of n over i, i = 0 .. fewer, as sum * 2^exponent: from n = 1024 on a binomial may be beyond a double
  constexpr int kScale = 512;
  double term = 1, sum = 1;
  std::int64_t exponent = 0;
  for (std::uint64_t i = 0; i < fewer; ++i) {
    term = term * static_cast<double>(n - i) / static_cast<double>(i + 1);
    sum += term;
    if (sum < std::ldexp(1.0, kScale)) continue;
    term = std::ldexp(term, -kScale), sum = std::ldexp(sum, -kScale);
    exponent += kScale;
  }
  const std::int64_t power = std::max<std::int64_t>(exponent + 1 - static_cast<std::int64_t>(n), -10'000);
  return std::min(1.0, std::ldexp(sum, static_cast<int>(power)));
}

double Quantile(std::vector<double> values, double q) {
  if (values.empty()) return std::numeric_limits<double>::quiet_NaN();
  const double position = q * static_cast<double>(values.size() - 1);
  const auto at = values.begin() + static_cast<std::ptrdiff_t>(position);
  // only the two values around the position need their places: the policy server asks after every answer
  std::nth_element(values.begin(), at, values.end());
  const double above = at + 1 == values.end() ? *at : *std::min_element(at + 1, values.end());
  return std::lerp(*at, above, position - std::floor(position));
}

double Mean(const std::vector<double>& values) {
  if (values.empty()) return std::numeric_limits<double>::quiet_NaN();
  return std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
}

}  // namespace etude
