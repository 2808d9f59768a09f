// SPDX-License-Identifier: Apache-2.0
#include "services/cli/results_comparison.h"

#include <fmt/format.h>

#include "services/cli/results_report.h"

namespace etude::cli {
namespace {

bool Holds(const OrderedJson& comparison, const std::string& with, std::uint64_t seed,
           const std::vector<ResultLine>& lines) {
  const auto* name = FindPart(comparison, "with");
  const auto* hash = FindPart(comparison, "with_sha256");
  if (!name || !hash || *name != OrderedJson(with)) return false;
  for (const auto& line : lines)
    for (const auto& measured : line.reports)
      if (line.row->name == with && measured.seed == seed) return *hash == OrderedJson(RolloutsHash(measured.report));
  return false;
}

}  // namespace

std::optional<PairedRollouts> PairedRollouts::From(const OrderedJson& report) {
  const auto* overall = FindPart(report, "comparison", "overall");
  if (!overall) return std::nullopt;
  const auto n = CountAt(*overall, "n"), both = CountAt(*overall, "both"), first = CountAt(*overall, "only_first"),
             second = CountAt(*overall, "only_second");
  if (!n || !both || !first || !second || *n == 0 || *both + *first + *second > *n) return std::nullopt;
  return PairedRollouts{*n, *both, *first, *second, 1};
}

PairedRollouts PairedRollouts::Of(const ResultLine& line) {
  PairedRollouts all;
  for (const auto& measured : line.reports) {
    const auto paired = From(measured.report);
    if (!paired) return {};
    all.Add(*paired);
  }
  return all;
}

void PairedRollouts::Add(const PairedRollouts& other) {
  n += other.n;
  both += other.both;
  only_first += other.only_first;
  only_second += other.only_second;
  seeds += other.seeds;
}

double PairedRollouts::difference() const {
  return 100 * (static_cast<double>(only_first) - static_cast<double>(only_second)) / static_cast<double>(n);
}

Interval PairedRollouts::interval() const {
  const auto shares = NewcombePairedInterval(both, only_first, only_second, n - both - only_first - only_second);
  return {100 * shares.low, 100 * shares.high};
}

std::string PairedRollouts::text() const {
  const std::string counts = fmt::format("{} | {} | {} | {:.1f}", n, only_first, only_second, difference());
  if (seeds > 1) return counts + " | -";
  return fmt::format("{} [{:.1f}, {:.1f}] | {:.2g}", counts, interval().low, interval().high,
                     McNemarExactP(only_first, only_second));
}

std::vector<ResultLine> WithComparisonsThatHold(std::vector<ResultLine> lines) {
  for (auto& line : lines) {
    const std::string& with = line.row->compare;
    for (auto& measured : line.reports) {
      const auto* comparison = FindPart(measured.report, "comparison");
      if (!comparison || Holds(*comparison, with, measured.seed, lines)) continue;
      measured.report.erase("comparison");
      if (!with.empty()) measured.report["comparison"]["missing"] = "of other rollouts";
    }
  }
  return lines;
}

}  // namespace etude::cli
