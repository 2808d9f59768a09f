// SPDX-License-Identifier: Apache-2.0
#include "trainer/policy/quantities/output.h"

#include "services/episode/action.h"

namespace etude::policy {

Normalization Normalization::Unit(int joints) {
  return {.joint_mean = torch::zeros({joints}),
          .joint_std = torch::ones({joints}),
          .position_mean = torch::zeros({3}),
          .position_std = torch::ones({3}),
          .displacement_std = torch::ones({3}),
          .offset_std = torch::ones({kWaypoints, 3})};
}

torch::Tensor PositionOf(const ModuleOutput& output) {
  const auto pose = output.decoded.find("pose");
  return pose != output.decoded.end() ? pose->second.narrow(-1, 0, 3) : output.decoded.at("position");
}

torch::Tensor Target::Clean() const {
  torch::Tensor mask = valid;
  while (mask.dim() < value.dim()) mask = mask.unsqueeze(-1);
  return torch::where(mask, value, torch::zeros_like(value));
}

torch::Tensor Masked::Mean() const {
  const torch::Tensor mask = valid.expand(loss.sizes());
  return torch::where(mask, loss, torch::zeros_like(loss)).sum() / mask.sum().clamp_min(1);
}

}  // namespace etude::policy
