// SPDX-License-Identifier: Apache-2.0
// What quantities share that are one of a list of names: logits, cross-entropy, accuracy.
#pragma once

#include "trainer/policy/quantities/common.h"

namespace etude::policy {

/// Head::classes are the names. What a label is, is the subclass's.
class Categorical : public Quantity {
 public:
  std::vector<std::int64_t> label_shape() const override { return {}; }
  int width(const Head& head) const override { return static_cast<int>(head.classes.size()); }
  void Decode(const Head& head, const Decoding& decoding, const torch::Tensor& raw,
              ModuleOutput& output) const override;
  int feature_width(const Head& head, bool fourier) const override { return fourier ? 0 : width(head); }
  /// Probabilities.
  torch::Tensor Feature(const ModuleOutput& output, const Normalization& normalization, bool fourier,
                        bool detach) const override;
  torch::Tensor Loss(const Head& head, const LossesConfig& losses, const ModuleOutput& output, const Target& target,
                     const PictureView& view) const override;
  std::vector<Metric> Measure(const Head& head, const ModuleOutput& output, const Target& target) const override;
  void Say(const Head& head, const ModuleOutput& output, OrderedJson& words) const override;

 protected:
  Categorical(std::string_view name, std::string_view meaning) : Quantity(name, "-", meaning) {}
  /// The label that says `name`; none where the list lacks it.
  static void FillName(std::span<const std::string> names, std::string_view name, std::span<float> values,
                       std::span<std::uint8_t> valid);

 private:
  const torch::Tensor& LogitsOf(const ModuleOutput& output) const;
};

}  // namespace etude::policy
