// SPDX-License-Identifier: Apache-2.0
#include "services/export/feature_statistics.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "services/core/statistics.h"

namespace etude::exports {
namespace {

FeatureStatistics Zeros(std::size_t dimensions) {
  FeatureStatistics zeros;
  for (auto* numbers : {&zeros.min, &zeros.max, &zeros.mean, &zeros.std}) numbers->assign(dimensions, 0.0);
  for (auto& quantile : zeros.quantiles) quantile.assign(dimensions, 0.0);
  return zeros;
}

// `sorted` is not empty
void PutColumn(const std::vector<double>& sorted, std::size_t column, FeatureStatistics& statistics) {
  const auto count = static_cast<double>(sorted.size());
  double sum = 0, squares = 0;
  for (const double value : sorted) sum += value;
  const double mean = sum / count;
  for (const double value : sorted) squares += (value - mean) * (value - mean);
  statistics.min[column] = sorted.front();
  statistics.max[column] = sorted.back();
  statistics.mean[column] = mean;
  statistics.std[column] = std::sqrt(squares / count);
  for (std::size_t q = 0; q < kQuantiles.size(); ++q)
    statistics.quantiles[q][column] = Quantile(sorted, kQuantiles[q] / 100.0);
}

// the byte below which `rank` of all lie
int ByteAt(const std::array<std::uint64_t, 256>& counts, double rank) {
  double below = 0;
  for (int byte = 0; byte < 256; ++byte) {
    below += static_cast<double>(counts[static_cast<std::size_t>(byte)]);
    if (below > rank) return byte;
  }
  return 255;
}

void PutChannel(const std::array<std::uint64_t, 256>& counts, std::size_t channel, FeatureStatistics& statistics) {
  double total = 0, sum = 0, squares = 0;
  for (std::size_t byte = 0; byte < 256; ++byte) {
    const auto n = static_cast<double>(counts[byte]);
    const double value = static_cast<double>(byte) / 255;
    total += n;
    sum += n * value;
    squares += n * value * value;
  }
  if (total == 0) return;
  const double mean = sum / total;
  statistics.min[channel] = ByteAt(counts, 0) / 255.0;
  statistics.max[channel] = ByteAt(counts, total - 1) / 255.0;
  statistics.mean[channel] = mean;
  statistics.std[channel] = std::sqrt(std::max(0.0, squares / total - mean * mean));
  for (std::size_t q = 0; q < kQuantiles.size(); ++q)
    statistics.quantiles[q][channel] = ByteAt(counts, kQuantiles[q] / 100.0 * (total - 1)) / 255.0;
}

OrderedJson Numbers(const std::vector<double>& numbers, bool is_picture) {
  OrderedJson list = OrderedJson::array();
  for (const double number : numbers) {
    if (is_picture)
      list.push_back(OrderedJson::array({OrderedJson::array({number})}));
    else
      list.push_back(number);
  }
  return list;
}

}  // namespace

FeatureStatistics StatisticsOf(std::span<const double> values, std::size_t columns) {
  FeatureStatistics statistics = Zeros(columns);
  if (columns == 0) return statistics;
  const std::size_t rows = values.size() / columns;
  statistics.count = static_cast<std::int64_t>(rows);
  std::vector<double> sorted;
  for (std::size_t column = 0; column < columns; ++column) {
    sorted.clear();
    for (std::size_t row = 0; row < rows; ++row)
      if (const double value = values[row * columns + column]; std::isfinite(value)) sorted.push_back(value);
    std::sort(sorted.begin(), sorted.end());
    if (!sorted.empty()) PutColumn(sorted, column, statistics);
  }
  return statistics;
}

void PictureStatistics::Add(std::span<const std::uint8_t> rgb) {
  for (std::size_t i = 0; i + 2 < rgb.size(); i += 3)
    for (std::size_t channel = 0; channel < 3; ++channel) ++counts_[channel][rgb[i + channel]];
  ++pictures_;
}

FeatureStatistics PictureStatistics::Finish() const {
  FeatureStatistics statistics = Zeros(3);
  statistics.count = pictures_;
  for (std::size_t channel = 0; channel < 3; ++channel) PutChannel(counts_[channel], channel, statistics);
  return statistics;
}

FeatureStatistics Merge(const FeatureStatistics& a, const FeatureStatistics& b) {
  if (a.count == 0) return b;
  if (b.count == 0) return a;
  FeatureStatistics all = Zeros(a.dimensions());
  const auto n = static_cast<double>(a.count), m = static_cast<double>(b.count);
  all.count = a.count + b.count;
  for (std::size_t i = 0; i < a.dimensions(); ++i) {
    all.min[i] = std::min(a.min[i], b.min[i]);
    all.max[i] = std::max(a.max[i], b.max[i]);
    all.mean[i] = (n * a.mean[i] + m * b.mean[i]) / (n + m);
    const double from_a = a.mean[i] - all.mean[i], from_b = b.mean[i] - all.mean[i];
    all.std[i] = std::sqrt((n * (a.std[i] * a.std[i] + from_a * from_a) + m * (b.std[i] * b.std[i] + from_b * from_b)) /
                           (n + m));
    for (std::size_t q = 0; q < kQuantiles.size(); ++q) {
      const double x = a.quantiles[q][i], y = b.quantiles[q][i];
      all.quantiles[q][i] = kQuantiles[q] <= 50 ? std::min(x, y) : std::max(x, y);
    }
  }
  return all;
}

OrderedJson ToJson(const FeatureStatistics& statistics, bool is_picture, WithQuantiles quantiles) {
  OrderedJson json{{"min", Numbers(statistics.min, is_picture)},
                   {"max", Numbers(statistics.max, is_picture)},
                   {"mean", Numbers(statistics.mean, is_picture)},
                   {"std", Numbers(statistics.std, is_picture)},
                   {"count", OrderedJson::array({statistics.count})}};
  if (quantiles == WithQuantiles::kYes)
    for (std::size_t q = 0; q < kQuantiles.size(); ++q)
      json[fmt::format("q{:02d}", kQuantiles[q])] = Numbers(statistics.quantiles[q], is_picture);
  return json;
}

}  // namespace etude::exports
