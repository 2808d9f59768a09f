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

/// Exact two-sided McNemar test of two classifiers on the same cases: the probability that a fair coin splits the cases
/// on which just one of them was right at least as unevenly as `only_first` to `only_second`. 1 when there are none.
/// Source: McNemar (1947), "Note on the sampling error of the difference between correlated proportions"; the binomial
/// sum itself, without the approximation by chi-squared. Cost: O(min of the two).
double McNemarExactP(std::uint64_t only_first, std::uint64_t only_second);

/// Difference of two proportions on the same cases, first - second, 95 %: the score interval for paired data, with
/// a continuity correction to their correlation. (-1, 1) when there are no cases.
/// Source: Newcombe (1998), "Improved confidence intervals for the difference between binomial proportions based on
/// paired data", method 10.
Interval NewcombePairedInterval(std::uint64_t both, std::uint64_t only_first, std::uint64_t only_second,
                                std::uint64_t neither);

/// Linear-interpolated quantile of unsorted values, q in [0, 1]; NaN when empty.
double Quantile(std::vector<double> values, double q);
double Mean(const std::vector<double>& values);

}  // namespace etude
