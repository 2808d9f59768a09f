// SPDX-License-Identifier: Apache-2.0
#include "trainer/policy/quantities/point.h"

namespace etude::policy {

using torch::Tensor;

Tensor Point::Loss(const Head&, const LossesConfig& losses, const ModuleOutput& output, const Target& target,
                   const PictureView& view) const {
  const SmoothL1Config& cost = CostOf(losses);
  const Tensor label = target.Clean(), counts = Counts(label, view);
  const Tensor loss = SmoothL1(SaidOf(output) / cost_unit(), label / cost_unit(), cost).mean(-1);
  return Masked{cost.weight * loss, counts.defined() ? target.valid & counts : target.valid}.Mean();
}

std::vector<Metric> Point::Measure(const Head&, const ModuleOutput& output, const Target& target) const {
  const Tensor distance = Distance(SaidOf(output), target.value, size_);
  return {{unit() == "m" ? "cm" : std::string(unit()), distance, target.valid, metric_scale(), Metric::Role::kError}};
}

void Point::Say(const Head&, const ModuleOutput& output, OrderedJson& words) const {
  words["value"] = Rounded(SaidOf(output));
}

}  // namespace etude::policy
