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

Interval NewcombePairedInterval(std::uint64_t both, std::uint64_t only_first, std::uint64_t only_second,
                                std::uint64_t neither) {
  const std::uint64_t n = both + only_first + only_second + neither;
  if (n == 0) return {-1, 1};
  const double a = static_cast<double>(both), b = static_cast<double>(only_first);
  const double c = static_cast<double>(only_second), d = static_cast<double>(neither), count = static_cast<double>(n);
  const double p1 = (a + b) / count, p2 = (a + c) / count;
  const Interval first = WilsonInterval(both + only_first, n), second = WilsonInterval(both + only_second, n);
  // the correlation of the two, drawn towards 0 where it is positive: a d - b c loses n / 2, but not its sign
  const double product = (a + b) * (c + d) * (a + c) * (b + d);
  double phi = a * d - b * c;
  if (phi > 0) phi = std::max(phi - count / 2, 0.0);
  phi = product > 0 ? phi / std::sqrt(product) : 0;
  const auto half = [&](double x, double y) { return std::sqrt(std::max(0.0, x * x - 2 * phi * x * y + y * y)); };
  const double difference = p1 - p2;
  return {std::max(-1.0, difference - half(p1 - first.low, second.high - p2)),
          std::min(1.0, difference + half(first.high - p1, p2 - second.low))};
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
