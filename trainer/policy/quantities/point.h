// SPDX-License-Identifier: Apache-2.0
// What quantities share that are a few plain numbers: their loss, metric and words. What a label is and how they are
// decoded is the subclass's.
#pragma once

#include "trainer/policy/quantities/common.h"

namespace etude::policy {

/// Of metres, unless a subclass says otherwise.
class Point : public Quantity {
 public:
  std::vector<std::int64_t> label_shape() const override { return {size_}; }
  int width(const Head&) const override { return size_; }
  torch::Tensor Loss(const Head& head, const LossesConfig& losses, const ModuleOutput& output, const Target& target,
                     const PictureView& view) const override;
  std::vector<Metric> Measure(const Head& head, const ModuleOutput& output, const Target& target) const override;
  void Say(const Head& head, const ModuleOutput& output, OrderedJson& words) const override;

 protected:
  Point(std::string_view name, std::string_view unit, std::string_view meaning, int size)
      : Quantity(name, unit, meaning), size_(size) {}
  /// What it decoded, (B, S', size).
  const torch::Tensor& SaidOf(const ModuleOutput& output) const { return output.decoded.at(std::string(name())); }

  virtual const SmoothL1Config& CostOf(const LossesConfig& losses) const = 0;
  virtual double cost_unit() const { return 1; }       ///< in which the loss is
  virtual double metric_scale() const { return 100; }  ///< cm
  /// Where a label counts, all being valid; undefined: everywhere.
  virtual torch::Tensor Counts(const torch::Tensor&, const PictureView&) const { return {}; }

 private:
  int size_;
};

}  // namespace etude::policy
